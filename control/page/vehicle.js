// The state of all devices, side by side: a row for each quantity, a column for each device.

// Flags that are shown while they hold, since they seldom do.
const ALARMS = /^(truth\.(tipping|.*_derated)|firmware\.(overcurrent|over_temperature|power_module).*)$/;
// Modes in which a vehicle does not do what its client says.
const HINDRANCES = /^mode\.(locked|parked|emergency_stop|remote)$/;

const words = (name) => name.split(".").at(-1).replaceAll("_", " ").replace(/ on$/, "");
const number = (value, digits) => (Number.isFinite(value) ? value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1") : "–");

// The rows: which names each needs, and what it shows of them. `read` gives the value of a name, if the device has it.
const ROWS = [
  ["position", [], ({ pose }) => pose && `${number(pose.x, 2)}, ${number(pose.y, 2)} m, ${number((pose.heading * 180) / Math.PI, 0)}°`],
  ["speed", ["truth.speed_mps"], ({ read }) => `${number(read("truth.speed_mps"), 2)} m/s`],
  ["mode", [/^mode\./, "motion.running"], ({ names, read }) => names.map((name) => ({
    text: words(name), isOn: read(name) === true, isBad: HINDRANCES.test(name),
  }))],
  ["in effect", [], ({ steps }) => steps.map((text) => ({ text, isOn: true }))],
  ["alarms", [ALARMS, "count.fuse_blown"], ({ names, read, pose }) => [
    ...names.filter((name) => read(name) === true).map(words),
    ...(read("count.fuse_blown") > 0 ? ["fuse blown"] : []),
    ...(pose?.touching ? ["collision"] : []),
  ]
    .map((text) => ({ text, isOn: true, isBad: true }))],
  ["charge", ["truth.soc_percent", "truth.battery_v", "truth.battery_a"], ({ read }) =>
    `${number(read("truth.soc_percent"), 1)} %, ${number(read("truth.battery_v"), 1)} V, ${number(read("truth.battery_a"), 1)} A`],
  ["outputs", [/^rail\..*_on$/, /^rail\..*_a$/], ({ names, read }) => names.filter((name) => name.endsWith("_on")).map((name) => {
    const [isOn, current] = [read(name) === true, read(name.replace(/_on$/, "_a"))];
    return { text: `${words(name)}${isOn || current > 0.005 ? ` ${number(current, 2)} A` : ""}`, isOn };
  })],
  ["mass", ["truth.mass_kg"], ({ read }) => `${number(read("truth.mass_kg"), 1)} kg`],
  ["client", ["client.attached"], ({ read, device }) => [
    { text: read("client.attached") ? "attached" : "not attached", isOn: read("client.attached") === true },
    ...device.report.map(({ code, count }) => ({ text: `${code} ×${count}`, isOn: true, isBad: true })),
  ]],
  ["port", [], ({ device }) => device.ports.map((port) => port.path).join(" ")],
];

export class Vehicle {
  constructor(table) {
    this.table = table;
    this.devices = [];
  }

  // `names` are all that there are; with one device they do not begin with its own.
  setUp(devices, names) {
    this.devices = devices.map((device) => {
      const prefix = devices.length > 1 ? `${device.identifier}.` : "";
      const own = new Set(names.filter((name) => name.startsWith(prefix)).map((name) => name.slice(prefix.length)));
      const rows = new Map(ROWS.map(([label, wanted]) => [
        label,
        wanted.flatMap((one) => (one instanceof RegExp ? [...own].filter((name) => one.test(name)) : own.has(one) ? [one] : [])),
      ]));
      return { prefix, rows };
    });
    // Wide enough for the words of each; beyond that the table is scrolled.
    this.table.style.minWidth = `${5 + 8 * devices.length}rem`;
    const head = document.createElement("tr");
    head.append(document.createElement("td"), ...devices.map((device) => {
      const cell = document.createElement("th");
      cell.scope = "col";
      cell.textContent = device.name;
      return cell;
    }));
    // A row that no device fills is left out.
    this.rows = ROWS.filter(([label, wanted]) => !wanted.length || this.devices.some(({ rows }) => rows.get(label).length));
    this.cells = new Map();
    const body = this.rows.map(([label]) => {
      const row = document.createElement("tr");
      row.dataset.row = label;
      const cell = document.createElement("th");
      cell.scope = "row";
      cell.textContent = label;
      const own = devices.map(() => document.createElement("td"));
      this.cells.set(label, own);
      row.append(cell, ...own);
      return row;
    });
    const [thead, tbody] = [document.createElement("thead"), document.createElement("tbody")];
    thead.append(head);
    tbody.append(...body);
    this.table.replaceChildren(thead, tbody);
  }

  // The names whose values it needs, those of the chosen device first.
  wanted(chosen) {
    const order = [...this.devices.keys()].sort((one, other) => (other === chosen) - (one === chosen));
    return order.flatMap((index) => {
      const { prefix, rows } = this.devices[index];
      return [...rows.values()].flat().map((name) => prefix + name);
    });
  }

  show(frame, values, devices, steps, chosen) {
    this.devices.forEach(({ prefix, rows }, index) => {
      const device = devices[index];
      for (const [label, wanted, say] of this.rows) {
        const names = rows.get(label);
        const cell = this.cells.get(label)[index];
        const content = wanted.length && !names.length ? "" : say({
          names, device, pose: frame?.devices[index], read: (name) => values[prefix + name],
          steps: steps.filter((step) => step.device === device.name).map((step) => step.text),
        });
        put(cell, content || "–");
        cell.classList.toggle("chosen", index === chosen && devices.length > 1);
      }
    });
  }
}

// A text, or pills of which each is on or off.
function put(cell, content) {
  const key = JSON.stringify(content);
  if (cell.dataset.key === key) return;
  cell.dataset.key = key;
  if (typeof content === "string") { cell.textContent = content; return; }
  if (!content.length) { cell.textContent = "none"; return; }
  cell.replaceChildren(...content.map(({ text, isOn, isBad }) => {
    const pill = document.createElement("span");
    pill.className = `pill${isOn ? (isBad ? " bad" : " on") : ""}`;
    if (text.length > 24) pill.classList.add("long");
    pill.textContent = text;
    if (!isOn) {
      const hidden = document.createElement("span");
      hidden.className = "hidden";
      hidden.textContent = ": no";
      pill.append(hidden);
    }
    return pill;
  }));
}
