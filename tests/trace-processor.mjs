// Serves a trace by Perfetto's own trace processor at a Unix socket: the WebAssembly of its user interface.
//
//     node tests/trace-processor.mjs ENGINE TRACE SOCKET
//
// ENGINE is a folder with engine_bundle.js and trace_processor.wasm.
import { readFileSync } from "node:fs";
import { createServer } from "node:net";
import { join } from "node:path";

const [engine, trace, path] = process.argv.slice(2);
// What a worker of a browser has, as far as the program uses it.
class XMLHttpRequest {
  open(_method, url) {
    this.file = join(engine, url.split("/").pop());
  }
  send() {
    this.response = readFileSync(this.file);
  }
}
const self = { location: { href: "http://localhost/" } };
const program = readFileSync(join(engine, "engine_bundle.js"), "utf8");
// Without a process, it does not see that this is Node.
new Function("self", "XMLHttpRequest", "WorkerGlobalScope", "process", program)(self, XMLHttpRequest, self);

let client;
const port = { postMessage: (bytes) => client?.write(bytes) };
self.onmessage({ data: port });
const varint = (number) => (number < 128 ? [number] : [128 + (number % 128), ...varint(Math.floor(number / 128))]);
/** Sends a TraceProcessorRpc with the number of its method and another field. */
const ask = (method, ...field) => {
  const message = Buffer.concat([Buffer.from([0x10, method]), ...field]);
  port.onmessage({ data: Buffer.concat([Buffer.from([0x0a, ...varint(message.length)]), message]) });
};
const bytes = readFileSync(trace);
// TPM_APPEND_TRACE_DATA with append_trace_data, and TPM_FINALIZE_TRACE_DATA.
setTimeout(() => {
  ask(1, Buffer.from([...varint((101 << 3) | 2), ...varint(bytes.length)]), bytes);
  ask(2);
  createServer((connection) => {
    client = connection.on("data", (data) => port.onmessage({ data }));
  }).listen(path);
});
