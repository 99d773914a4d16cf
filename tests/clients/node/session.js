// A client on node-serialport, or on node's own sockets: session.js PORT|tcp://HOST:PORT

const net = require('net');

const VERSION = Buffer.from('AA5500F0F707', 'hex');

const open = (path, baudRate) =>
  new Promise((resolve, reject) => {
    const { SerialPort } = require('serialport');
    const port = new SerialPort({ path, baudRate }, (error) =>
      error ? reject(error) : resolve(port));
  });
const connect = (url) =>
  new Promise((resolve, reject) => {
    const { hostname, port } = new URL(url);
    const socket = net.connect(port, hostname, () => resolve(socket));
    socket.on('error', reject);
  });
const disconnect = (socket) => new Promise((resolve) => socket.once('close', resolve).destroy());
const close = (port) =>
  new Promise((resolve, reject) => port.close((error) => (error ? reject(error) : resolve())));
const update = (port, baudRate) =>
  new Promise((resolve, reject) =>
    port.update({ baudRate }, (error) => (error ? reject(error) : resolve())));
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// Motors 20 %: made here, so that nothing is shared with the program under test.
function frame(command, parameters) {
  const body = Buffer.from([command, ...parameters]);
  let crc = 0xffff;
  for (const byte of body) {
    crc ^= byte;
    for (let i = 0; i < 8; i++) crc = (crc >> 1) ^ (crc & 1 ? 0x8408 : 0);
  }
  crc ^= 0xffff;
  return Buffer.concat([
    Buffer.from([0xaa, 0x55, parameters.length]), body, Buffer.from([crc & 0xff, crc >> 8])]);
}

function ask(port, request, length) {
  return new Promise((resolve, reject) => {
    let heard = Buffer.alloc(0);
    const late = setTimeout(() => {
      port.removeAllListeners('data');
      reject(new Error(`${heard.toString('hex')} to ${request.toString('hex')}`));
    }, 5000);
    port.on('data', (data) => {
      heard = Buffer.concat([heard, data]);
      if (heard.length >= length) {
        clearTimeout(late);
        port.removeAllListeners('data');
        if (heard[3] === request[3]) resolve(heard);
        else reject(new Error(`${heard.toString('hex')} to ${request.toString('hex')}`));
      }
    });
    port.write(request);
  });
}

async function drive(port) {
  await ask(port, VERSION, 14);
  for (let i = 0; i < 3; i++) {
    await ask(port, frame(0x12, [200, 0, 200, 0]), 14);
    await pause(60);
  }
  await ask(port, frame(0x12, [0, 0, 0, 0]), 14);
}

async function main(path) {
  for (let round = 0; round < 2; round++) {
    if (path.startsWith('tcp:')) {
      // Which has no speed.
      const socket = await connect(path);
      await drive(socket);
      await disconnect(socket);
      continue;
    }
    const port = await open(path, 115200);
    await drive(port);
    await update(port, 9600);
    port.write(VERSION);
    await pause(200);
    await update(port, 115200);
    await pause(100);
    await new Promise((resolve) => port.flush(resolve));
    while (port.read()) { /* what was buffered here */ }
    await ask(port, VERSION, 14);
    await close(port);
  }
}

main(process.argv[2]).then(
  () => process.exit(0),
  (error) => { console.error(error); process.exit(1); });
