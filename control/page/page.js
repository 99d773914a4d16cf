// The page: what there is, what happens, and what one can do.

import { Link, Refusal } from "./link.js";
import { Picture } from "./picture.js";
import { Charts } from "./charts.js";
import { faultForms, operatorForms } from "./forms.js";

const MOST_LINES = 1000;
// Between two tries to reach a simulator that does not answer.
const AGAIN_MS = 2000;
const element = (id) => document.getElementById(id);
const link = new Link();
const picture = new Picture(element("picture"));
const charts = new Charts(element("charts"), listen);
let state = null;
let schema = null;
let units = new Map();
let chosen = 0;
let stop = null;
let paused = false;

// Says how things stand.
function tell(text, bad = false) {
  element("state").textContent = text;
  element("state").classList.toggle("bad", bad);
}

async function refresh() {
  state = await link.call("GET", "/v1/state");
  picture.setState(state);
  element("title").textContent = state.title ?? "";
  setTime(state);
  showSteps(state.steps);
}

function setTime(time) {
  // In lockstep it is the client's.
  for (const button of element("time").querySelectorAll("button, select")) button.disabled = time.speed === null;
  if (time.speed === null) return;
  paused = time.paused;
  element("pause").textContent = paused ? "Go on" : "Pause";
  element("pause").classList.toggle("on", paused);
  const speed = String(time.speed);
  const select = element("speed");
  if (![...select.options].some((option) => option.value === speed)) select.append(new Option(speed, speed));
  select.value = speed;
}

async function start() {
  tell("connecting");
  [schema] = await Promise.all([link.call("GET", "/v1/schema"), refresh()]);
  const names = await link.call("GET", "/v1/names");
  units = new Map(names.names.map((one) => [one.name, one.unit]));
  element("names").replaceChildren(...names.names.map((one) => {
    const option = new Option("", one.name);
    option.label = one.meaning;
    return option;
  }));
  showDevices();
  if (!charts.names.length) charts.add(nameOf("truth.speed_mps"), "m/s");
  listen();
}

function begin() {
  start().catch((error) => {
    failed(error);
    // Who is refused once is refused again.
    if (!(error instanceof Refusal)) setTimeout(begin, AGAIN_MS);
  });
}

function nameOf(name) {
  if (state.devices.length < 2) return name;
  return `${state.devices[chosen].identifier}.${name}`;
}

function showDevices() {
  element("devices").replaceChildren(...state.devices.map((device, index) => {
    const button = document.createElement("button");
    button.textContent = device.name;
    button.title = device.ports.map((port) => port.path).join("\n");
    button.role = "tab";
    button.ariaSelected = String(index === chosen);
    button.addEventListener("click", () => { chosen = index; showDevices(); });
    return button;
  }));
  picture.chosen = chosen;
  picture.dirty = true;
  const device = state.devices[chosen];
  const able = schema.operators[device.kind];
  const send = async (step) => {
    await link.call("POST", "/v1/steps", { device: device.name, ...step });
    await refresh();
  };
  element("operator").replaceChildren(...operatorForms(schema.step, able, send));
  element("faults").replaceChildren(...faultForms(schema.step, schema.faults, device.kind, send));
  filterFaults();
}

function filterFaults() {
  const wanted = element("find").value.toLowerCase();
  for (const form of element("faults").children) form.hidden = !form.dataset.title.toLowerCase().includes(wanted);
}

function showSteps(steps) {
  element("steps").replaceChildren(...steps.slice(-30).map((step) => {
    const item = document.createElement("li");
    item.className = step.state;
    const text = document.createElement("span");
    text.textContent = `${step.name}: ${step.state}${step.why ? `, ${step.why}` : ""}`;
    item.append(text);
    if (step.clearable) {
      const clear = document.createElement("button");
      clear.textContent = "Clear";
      clear.addEventListener("click", () => link.call("DELETE", `/v1/steps/${encodeURIComponent(step.name)}`).then(refresh, failed));
      item.append(clear);
    }
    return item;
  }));
}

function failed(error) { tell(error.message, true); }

// Begins the stream anew, with what is to be told now.
function listen() {
  if (!state) return;
  stop?.();
  const query = { picture: 60, traffic: element("traffic").checked };
  if (charts.names.length) Object.assign(query, { names: charts.names.join(","), rate: 20 });
  stop = link.listen(query, take, (error) => {
    tell(error ? error.message : "the simulation has ended", true);
    setTimeout(begin, AGAIN_MS);
  });
  tell("live");
}

function take(kind, data) {
  if (kind === "picture") {
    picture.setNow(data);
    element("clock").textContent = `${data.t.toFixed(3)} s`;
  } else if (kind === "values") charts.take(data);
  else if (kind === "log") addLine(data);
  else if (kind === "time") setTime(data);
  else if (kind === "step") refreshSoon();
  else if (kind === "lost") element("lost").textContent = `${data.messages} lines left out: too many`;
  else if (kind === "end") tell("the simulation has ended", true);
}

let refreshing = null;
function refreshSoon() {
  refreshing ??= setTimeout(() => { refreshing = null; refresh().catch(failed); }, 100);
}

const waiting = [];
function addLine(data) {
  waiting.push(data);
  if (waiting.length > MOST_LINES) waiting.splice(0, waiting.length - MOST_LINES);
}

// A pass for all lines that have come, so that busy traffic costs no more than a picture.
function showLines() {
  if (waiting.length) {
    const lines = element("lines");
    lines.append(...waiting.splice(0).map((data) => {
      const item = document.createElement("li");
      item.className = data.role;
      item.textContent = data.line;
      return item;
    }));
    while (lines.childElementCount > MOST_LINES) lines.firstElementChild.remove();
    if (element("scroll").checked) lines.scrollTop = lines.scrollHeight;
  }
  requestAnimationFrame(showLines);
}
requestAnimationFrame(showLines);

const time = (change) => link.call("POST", "/v1/time", change).then(setTime, failed);
element("pause").addEventListener("click", () => time(paused ? "go_on" : "pause"));
element("step").addEventListener("click", () => time({ step: element("by").value }));
element("speed").addEventListener("change", () => time({ speed: Number(element("speed").value) }));
element("find").addEventListener("input", filterFaults);
element("traffic").addEventListener("change", listen);
element("wrong").addEventListener("change", () => element("lines").classList.toggle("wrong", element("wrong").checked));
element("fit").addEventListener("click", () => picture.fit());
for (const [id, what] of [["follow", "follow"], ["rays", "rays"], ["trails", "trails"]]) {
  element(id).addEventListener("change", () => { picture.show[what] = element(id).checked; picture.dirty = true; });
}
element("choose").addEventListener("submit", (event) => {
  event.preventDefault();
  const name = element("name").value.trim();
  if (units.has(name)) { charts.add(name, units.get(name)); element("name").value = ""; }
  else tell(`there is no name ${name}`, true);
});
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (["INPUT", "SELECT", "BUTTON", "SUMMARY"].includes(event.target.tagName)) return;
  if (event.key === " ") { event.preventDefault(); element("pause").click(); }
  else if (event.key === ".") element("step").click();
});

// For tests and for the curious: what is drawn.
window.sim = { picture, charts, get state() { return state; } };
begin();
