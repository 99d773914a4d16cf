// The same with serialport for Node.
const { SerialPort } = require('serialport')
const motors = Buffer.from([0xaa, 0x55, 4, 0x12, 0x2c, 1, 0x2c, 1, 0x1e, 0xb4])
const start = performance.now()
let bytes = 0
let again = false
let over = false

function connect() {
  const port = new SerialPort({ path: process.env.SIM_R150_PORT, baudRate: 115200, autoOpen: false, lock: false })
  port.open((error) => {
    if (error) return setTimeout(connect, 30)
    if (again) console.log('came back at', Math.round(performance.now() - start))
    again = true
    const driving = setInterval(() => port.write(motors), 100)
    port.on('data', (data) => { bytes += data.length })
    port.on('error', () => {})
    port.on('close', () => {
      clearInterval(driving)
      if (!over) setTimeout(connect, 30)
    })
    setTimeout(() => {
      over = true
      console.log('processors', require('os').cpus().length)
      if (port.isOpen) port.close(() => { console.log('bytes', bytes); process.exit(0) })
    }, Math.max(0, 2500 - (performance.now() - start)))
  })
}
connect()
