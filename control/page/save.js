// What was done by hand, as a scenario file.

// A value in TOML. Strings of JSON are strings of TOML, too.
function toml(value) {
  if (Array.isArray(value)) return `[${value.map(toml).join(", ")}]`;
  if (value !== null && typeof value === "object") {
    return `{ ${Object.entries(value).map(([key, one]) => `${/^[\w-]+$/.test(key) ? key : JSON.stringify(key)} = ${toml(one)}`).join(", ")} }`;
  }
  return JSON.stringify(value);
}

const seconds = (t) => `${Number(t.toFixed(6))} s`;

// A step in a few words: what it does, and with what.
export function summary(step) {
  const [key, does] = Object.entries(step).find(([name]) => ["fault", "operator", "world", "expect", "clear"].includes(name)) ?? ["", ""];
  const flat = (value) => (value !== null && typeof value === "object" ? Object.entries(value).map(([name, one]) =>
    (Array.isArray(value) ? flat(one) : one === true ? name : `${name} ${flat(one)}`)).join(" ") : String(value));
  if (key === "fault") {
    const { kind, ...rest } = does;
    return [kind, ...Object.entries(rest).map(([name, value]) => `${name} ${flat(value)}`)].join(", ");
  }
  if (typeof does === "string") return does.replaceAll("_", " ");
  const [[name, value]] = Object.entries(does);
  return name.replaceAll("_", " ") + (value === true ? " on" : value === false ? " off" : ` ${flat(value)}`);
}

// The steps that were added here. They outlive the page being loaded again, but not the tab.
export class Journal {
  constructor(key) {
    this.key = `sim-journal-${key}`;
    try { this.entries = JSON.parse(sessionStorage.getItem(this.key)) ?? []; } catch { this.entries = []; }
  }

  get length() { return this.entries.length; }

  // A step was asked for, and this was the answer.
  add(step, { name, begun_s: begun }) {
    this.entries.push({ step, name, begun, ended: null, hits: 0 });
    this.#keep();
  }

  // How the steps are now: which of them were cleared, and which have hit something.
  look(steps, now) {
    let isNew = false;
    for (const entry of this.entries) {
      const step = steps.find((one) => one.name === entry.name && one.begun_s === entry.begun);
      if (!step) continue;
      if (step.hits !== entry.hits) { entry.hits = step.hits; isNew = true; }
      if (entry.wasClearable && !step.clearable && entry.ended === null && !entry.step.for) { entry.ended = now; isNew = true; }
      entry.wasClearable = step.clearable;
    }
    if (isNew) this.#keep();
  }

  // A step was cleared at this time.
  clear(name, t) {
    for (const entry of this.entries) if ((name === null || entry.name === name) && entry.ended === null && entry.wasClearable) entry.ended = t;
    this.#keep();
  }

  #keep() {
    try { sessionStorage.setItem(this.key, JSON.stringify(this.entries)); } catch { /* It is lost when the page is loaded again. */ }
  }

  // The file: `beginning` has the same devices; names of steps in it are `taken`.
  file(beginning, { title, now, taken }) {
    const isBased = /^base = /m.test(beginning);
    const limit = Math.ceil(Math.max(now, ...this.entries.map(({ begun, ended }) => ended ?? begun)) + 5);
    const head = isBased ? "" : [
      `title = ${JSON.stringify(title)}`,
      'good_client = "Say here what a client should do about it."',
      `limit = "${limit} s"`, "",
    ].join("\n");
    const names = new Set(taken);
    // What was cleared at the instant at which it began did nothing.
    const entries = this.entries.filter(({ begun, ended }) => ended === null || ended - begun >= 1e-6);
    const steps = entries.map(({ step: { device, for: lasts, ...rest }, name, begun, ended, hits }) => {
      // A name that says what it is, once.
      const usual = /^step \d+$/.test(name) ? summary(rest).split(",")[0] : name;
      let own = usual;
      for (let count = 2; names.has(own); count += 1) own = `${usual} ${count}`;
      names.add(own);
      const lines = ["[[step]]", `name = ${JSON.stringify(own)}`, `at = ${JSON.stringify(seconds(begun))}`];
      const length = ended === null ? lasts : seconds(ended - begun);
      if (length) lines.push(`for = ${JSON.stringify(length)}`);
      if (device) lines.push(`device = ${JSON.stringify(device)}`);
      for (const [key, value] of Object.entries(rest)) if (key !== "name") lines.push(`${key} = ${toml(value)}`);
      // By hand it hit nothing either.
      if (rest.fault && !hits) lines.push("optional = true");
      return lines.join("\n");
    });
    return `# Saved from the page of sim. Run your client with it: sim run FILE -- CLIENT\n${head}${beginning}\n${steps.join("\n\n")}\n`;
  }
}
