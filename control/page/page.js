// The page: what there is, what happens, and what one can do.

import { Link, Refusal } from "./link.js";
import { Picture } from "./picture.js";
import { Charts } from "./charts.js";
import { History, Timeline } from "./history.js";
import { Vehicle } from "./vehicle.js";
import { Journal, summary } from "./save.js";
import { faultForms, operatorForms } from "./forms.js";

const MOST_LINES = 1000;
const MOST_NAMES = 256;
const MOST_NOTICES = 4;
// Steps that are over and still listed.
const MOST_OVER = 5;
// Between two tries to reach a simulator that does not answer.
const AGAIN_MS = 2000;
const GONE = "The simulation has ended. A new one prints a new URL.";
const element = (id) => document.getElementById(id);
const link = new Link();
const history = new History();
const picture = new Picture(element("picture"));
const charts = new Charts(element("charts"), history, listen);
const vehicle = new Vehicle(element("values"));
const journal = new Journal(link.token);
const timeline = new Timeline(history, {
  range: element("when"), marks: element("marks"), shown: element("shown"), live: element("live"),
}, lookAt);
let state = null;
let schema = null;
let units = new Map();
let chosen = 0;
let forms = []; // of the faults of the chosen device
let stop = null;
let paused = false;
let isLive = false; // the simulator answers
let hasEnded = false;
let isLost = false; // it did, and does no longer

function showStatus() {
  const text = hasEnded ? "ended" : !isLive ? (isLost ? "no answer" : "connecting") : paused ? "paused" : "live";
  element("state").textContent = text;
  element("state").className = text.replace(" ", "-");
  for (const id of ["faults", "operator"]) element(id).disabled = !isLive;
  element("time").disabled = !isLive || state?.speed === null;
  element("time").title = isLive && state?.speed === null ? "In lockstep, time belongs to the client." : "";
  for (const button of document.querySelectorAll("#clear, #steps button, #choose button")) button.disabled = !isLive;
}

// Something that went wrong, until it is dismissed; where it has a time, one can look at that.
const dismissed = new Set();
function notice(text, t = null) {
  const key = `${t} ${text}`;
  const notices = element("notices");
  if (dismissed.has(key) || [...notices.children].some((one) => one.dataset.key === key)) return;
  const item = document.createElement("div");
  item.className = "alert";
  item.dataset.key = key;
  const words = document.createElement("span");
  const expected = t !== null && state?.expected ? `\nExpected: ${state.expected}` : "";
  words.textContent = t === null ? text : `Failed at ${t.toFixed(3)} s: ${text}${expected}`;
  item.append(words);
  if (t !== null) {
    const show = document.createElement("button");
    show.textContent = "Show";
    show.title = "Look at this time";
    show.addEventListener("click", () => timeline.show(t));
    item.append(show);
  }
  const close = document.createElement("button");
  close.textContent = "×";
  close.title = "Dismiss";
  close.setAttribute("aria-label", "Dismiss");
  close.addEventListener("click", () => { dismissed.add(key); item.remove(); });
  item.append(close);
  notices.append(item);
  while (notices.childElementCount > MOST_NOTICES) {
    dismissed.add(notices.firstElementChild.dataset.key);
    notices.firstElementChild.remove();
  }
}

function failed(error) { notice(error.message); }

function fails({ t, what }) {
  notice(what, t);
  if (!timeline.failures.includes(t)) timeline.failures.push(t);
}

async function refresh() {
  state = await link.call("GET", "/v1/state");
  picture.setState(state);
  element("title").textContent = state.title ?? "";
  setTime(state);
  journal.look(state.steps, state.t);
  timeline.takeSteps(state.steps, state.t);
  showSteps(state.steps);
  state.failures.forEach(fails);
}

function setTime(time) {
  // In lockstep it is the client's.
  if (state) state.speed = time.speed;
  paused = time.paused;
  element("pause").textContent = paused ? "Resume" : "Pause";
  element("pause").classList.toggle("on", paused);
  if (time.speed !== null) {
    const speed = String(time.speed);
    const select = element("speed");
    if (![...select.options].some((option) => option.value === speed)) select.append(new Option(speed, speed));
    select.value = speed;
  }
  showStatus();
}

async function start() {
  showStatus();
  [schema] = await Promise.all([link.call("GET", "/v1/schema"), refresh()]);
  const { names } = await link.call("GET", "/v1/names");
  units = new Map(names.map((one) => [one.name, one.unit]));
  showNames(names);
  vehicle.setUp(state.devices, [...units.keys()]);
  [isLive, isLost, hasEnded] = [true, false, false];
  showDevices();
  showSteps(state.steps);
  if (!charts.names.length) chart("truth.speed_mps");
  listen();
}

function begin() {
  start().catch((error) => {
    // Who is refused once is refused again.
    if (error instanceof Refusal) { failed(error); return; }
    [isLive, isLost] = [false, true];
    showStatus();
    if (!hasEnded) failed(error);
    setTimeout(begin, AGAIN_MS);
  });
}

// The names to choose from: with several devices those without a device are of all that have them.
function showNames(names) {
  const bare = new Map();
  if (state.devices.length > 1) for (const one of names) bare.set(one.name.slice(one.name.indexOf(".") + 1), one.meaning);
  const all = [...bare].map(([name, meaning]) => ({ name, meaning })).concat(names);
  element("names").replaceChildren(...all.map((one) => {
    const option = new Option("", one.name);
    option.label = one.meaning ?? "";
    return option;
  }));
}

// Adds a chart of a name, of all devices where it does not say which; says whether there is any.
function chart(name) {
  if (units.has(name)) { charts.add(name, units.get(name)); return true; }
  const own = state.devices.map((device) => ({ name: `${device.identifier}.${name}`, label: device.name })).filter((one) => units.has(one.name));
  if (own.length) charts.add(name, units.get(own[0].name), own);
  return own.length > 0;
}

function showDevices() {
  element("devices").hidden = state.devices.length < 2;
  element("devices").replaceChildren(...state.devices.map((device, index) => {
    const button = document.createElement("button");
    button.textContent = device.name;
    button.title = device.ports.map((port) => port.path).join("\n");
    button.role = "tab";
    button.ariaSelected = String(index === chosen);
    button.addEventListener("click", () => { chosen = index; showDevices(); element("devices").children[index].focus(); });
    return button;
  }));
  picture.chosen = chosen;
  picture.dirty = true;
  const device = state.devices[chosen];
  const own = schema.steps[device.kind];
  const send = async (does) => {
    const step = state.devices.length > 1 ? { device: device.name, ...does } : does;
    journal.add(step, await link.call("POST", "/v1/steps", step));
    await refresh();
  };
  element("operator").replaceChildren(...operatorForms(own, schema.operators[device.kind], send));
  forms = faultForms(own, schema.faults, device.kind, device.ports.length, send);
  filterFaults();
}

function filterFaults() {
  const wanted = element("find").value.toLowerCase();
  for (const form of forms) form.hidden = !form.dataset.title.toLowerCase().includes(wanted);
  // Those whose names have it come first.
  const isNamed = (form) => form.dataset.name.toLowerCase().includes(wanted);
  element("faults").replaceChildren(...forms.filter(isNamed), ...forms.filter((form) => !isNamed(form)));
}

// What a step does, in a few words.
function wordsOf(step) {
  const own = journal.entries.find((entry) => entry.name === step.name && entry.begun === step.begun_s);
  const does = { expect: `expect ${step.what}`, clear: `clear ${step.what}`, host: "client" }[step.key] ?? step.what.replaceAll("_", " ");
  const text = own ? summary(own.step) : does;
  const name = step.name.replace(/ \d+$/, "");
  const isNamed = name !== "step" && text !== name && !text.startsWith(`${name},`);
  return isNamed ? (text ? `${step.name}: ${text}` : step.name) : text || step.name;
}

function stepItem(name) {
  const item = document.createElement("li");
  item.dataset.step = name;
  const text = document.createElement("span");
  const about = document.createElement("span");
  about.className = "about";
  text.append(document.createElement("b"), " ", about);
  item.append(text);
  return item;
}

function clearButton(name) {
  const clear = document.createElement("button");
  clear.textContent = "Clear";
  clear.disabled = !isLive;
  clear.addEventListener("click", () => revert(name));
  return clear;
}

function showSteps(steps) {
  const those = (...states) => steps.filter((step) => states.includes(step.state)).reverse();
  const shown = [...those("active", "waiting").slice(0, 100), ...those("failed").slice(0, MOST_OVER), ...those("done").slice(0, MOST_OVER)];
  const list = element("steps");
  const known = new Map([...list.children].map((item) => [item.dataset.step, item]));
  const items = shown.map((step) => {
    const item = known.get(step.name) ?? stepItem(step.name);
    known.delete(step.name);
    item.className = step.state;
    const words = wordsOf(step);
    item.querySelector("b").textContent = words;
    const when = step.begun_s === null ? "" : step.state === "active" ? ` since ${step.begun_s.toFixed(3)} s` : ` at ${step.begun_s.toFixed(3)} s`;
    const hits = step.key !== "fault" ? "" : step.hits === 1 ? ", hit once" : `, ${step.hits} hits`;
    const device = state.devices.length > 1 ? `${step.device}: ` : "";
    item.querySelector(".about").textContent = `${device}${step.state}${when}${hits}${step.why ? `. ${step.why}` : ""}`;
    if (!step.clearable) item.querySelector("button")?.remove();
    else if (!item.querySelector("button")) item.append(clearButton(step.name));
    item.querySelector("button")?.setAttribute("aria-label", `Clear ${words}`);
    return item;
  });
  // An item that stays is not touched: it may be about to be clicked, or have the focus.
  if (items.length !== list.childElementCount || items.some((item, at) => item !== list.children[at])) list.replaceChildren(...items);
  element("idle").hidden = steps.some((step) => step.state === "active");
  element("clear").hidden = steps.filter((step) => step.clearable && step.added).length < 2;
  element("save").hidden = !journal.length || !schema;
  element("save").textContent = `Save as scenario (${journal.length} ${journal.length === 1 ? "step" : "steps"})`;
}

// Clears a step, or all that were added.
async function revert(name) {
  try {
    const answer = await link.call("DELETE", name === null ? "/v1/steps" : `/v1/steps/${encodeURIComponent(name)}`);
    journal.clear(name, answer.t ?? history.last);
    await refresh();
  } catch (error) { failed(error); }
}

function save() {
  const title = state.title || "Saved from the page";
  const text = journal.file(schema.file, { title, now: history.last, taken: state.steps.filter((step) => !step.added).map((step) => step.name) });
  const anchor = document.createElement("a");
  anchor.href = URL.createObjectURL(new Blob([text], { type: "application/toml" }));
  anchor.download = "by-hand.toml";
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 10_000);
}

// Begins the stream again, with what is to be shown now.
function listen() {
  if (!state || !isLive) return;
  stop?.();
  const query = { picture: 60, traffic: element("traffic").checked };
  const names = [...new Set([...charts.names, ...vehicle.wanted(chosen)])].slice(0, MOST_NAMES);
  if (names.length) Object.assign(query, { names: names.join(","), rate: 20 });
  stop = link.listen(query, take, (error) => {
    // Without an end it may come back.
    if (!error) end();
    [isLive, isLost] = [false, true];
    showStatus();
    setTimeout(begin, AGAIN_MS);
  });
  showStatus();
}

function end() {
  if (hasEnded) return;
  hasEnded = true;
  isLive = false;
  showStatus();
  notice(GONE);
}

function takePicture(data) {
  picture.setNow(data);
  if (data.devices.every((device) => device.angles)) history.addFrame(data);
}

function take(kind, data) {
  if (kind === "picture") {
    takePicture(data);
    element("clock").textContent = `${data.t.toFixed(3)} s`;
  } else if (kind === "past") {
    if (!history.frames.length) {
      data.pictures.forEach(takePicture);
      data.log.forEach(addLine);
    }
    history.addPast(data.values);
    charts.refresh();
  } else if (kind === "values") { history.addValues(data); charts.refresh(); }
  else if (kind === "log") addLine(data);
  else if (kind === "time") setTime(data);
  else if (kind === "step") refreshSoon(100);
  else if (kind === "failure") {
    fails(data);
    addLine({ role: "failed", time_s: data.t, line: `${data.t.toFixed(6).padStart(12)} FAILED ${data.what}` });
    if (element("halt").checked && !paused && state.speed !== null) time("pause");
  } else if (kind === "lost") element("lost").textContent = `${data.messages} lines left out: too many`;
  else if (kind === "end") end();
}

let refreshing = null;
function refreshSoon(within) {
  refreshing ??= setTimeout(() => { refreshing = null; if (isLive) refresh().catch(failed); }, within);
}

// Shows everything as it was at this time, or as it is now.
function lookAt(t) {
  picture.past = t === null ? null : history.frameAt(t);
  picture.dirty = true;
  charts.show(t === null ? null : { t, end: Number(element("when").max) });
  element("past").textContent = t === null ? "" : `at ${t.toFixed(3)} s`;
  document.body.classList.toggle("past", t !== null);
  showVehicle();
  showPlace(t);
}

function showVehicle() {
  if (!state || !schema) return;
  const { past } = timeline;
  const t = past ?? history.last;
  const isActive = (step) => {
    const span = timeline.spans.get(step.name);
    if (!["fault", "operator", "world"].includes(step.key)) return false;
    return past === null ? step.state === "active" && step.clearable : span && span.from <= t && (span.to ?? Infinity) > t;
  };
  const steps = state.steps.filter(isActive).map((step) => ({ device: step.device, text: wordsOf(step) }));
  vehicle.show(history.frameAt(t), history.valuesAt(t)?.values ?? {}, state.devices, steps, chosen);
}
setInterval(showVehicle, 200);

// The last line of the log before this time.
function showPlace(t) {
  const lines = element("lines");
  lines.querySelector(".place")?.classList.remove("place");
  if (t === null) { if (element("scroll").checked) lines.scrollTop = lines.scrollHeight; return; }
  let [low, high] = [0, lines.childElementCount];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (lines.children[middle].t <= t) low = middle + 1; else high = middle;
  }
  const line = lines.children[Math.max(low - 1, 0)];
  if (!line) return;
  line.classList.add("place");
  lines.scrollTop = line.offsetTop - lines.clientHeight / 2;
}

const waiting = [];
function addLine(data) {
  waiting.push(data);
  if (waiting.length > MOST_LINES) waiting.splice(0, waiting.length - MOST_LINES);
  // What the machine did is not a mark of the client.
  if (data.role === "warning" && !data.code.includes("stall")) { timeline.takeWarning(data.time_s); refreshSoon(1000); }
}

// A pass for all lines that have come, so that busy traffic costs no more than a picture.
function showLines() {
  if (waiting.length) {
    const lines = element("lines");
    lines.append(...waiting.splice(0).map((data) => {
      const item = document.createElement("li");
      item.className = data.role;
      item.textContent = data.line.replace(/^ {1,4}/, "");
      item.t = data.time_s;
      return item;
    }));
    while (lines.childElementCount > MOST_LINES) lines.firstElementChild.remove();
    if (element("scroll").checked && timeline.past === null) lines.scrollTop = lines.scrollHeight;
  }
  requestAnimationFrame(showLines);
}
requestAnimationFrame(showLines);

const time = (change) => link.call("POST", "/v1/time", change).then(setTime, failed);
element("pause").addEventListener("click", () => time(paused ? "resume" : "pause"));
element("advance").addEventListener("click", () => time({ step: element("by").value }));
element("speed").addEventListener("change", () => time({ speed: Number(element("speed").value) }));
element("find").addEventListener("input", filterFaults);
element("clear").addEventListener("click", () => revert(null));
element("save").addEventListener("click", save);
element("traffic").addEventListener("change", listen);
element("wrong").addEventListener("change", () => element("lines").classList.toggle("wrong", element("wrong").checked));
element("fit").addEventListener("click", () => picture.fit());
for (const [id, what] of [["follow", "follow"], ["rays", "rays"], ["trails", "trails"]]) {
  element(id).addEventListener("change", () => { picture.show[what] = element(id).checked; picture.dirty = true; });
}
element("choose").addEventListener("submit", (event) => {
  event.preventDefault();
  const name = element("name").value.trim();
  if (chart(name)) element("name").value = "";
  else notice(`There is no name ${name}.`);
});
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (["INPUT", "SELECT", "BUTTON", "SUMMARY"].includes(event.target.tagName)) return;
  if (event.key === " ") { event.preventDefault(); element("pause").click(); }
  else if (event.key === ".") element("advance").click();
  else if (event.key === "/") { event.preventDefault(); element("find").focus(); }
});

// For tests and for the curious: what is drawn.
window.sim = { picture, charts, history, timeline, journal, get state() { return state; } };
begin();
