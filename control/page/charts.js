// Strip charts of chosen names over the last half minute of simulated time.

const SPAN = 30; // s
const COLOURS = ["accent", "good", "warn", "bad", "tag", "ray"];

export class Charts {
  constructor(place, changed) {
    this.place = place;
    this.changed = changed;
    this.charts = new Map();
    const frame = () => { for (const chart of this.charts.values()) chart.draw(); requestAnimationFrame(frame); };
    requestAnimationFrame(frame);
  }

  get names() { return [...this.charts.keys()]; }

  add(name, unit) {
    if (this.charts.has(name)) return;
    const chart = new Chart(name, unit, COLOURS[this.charts.size % COLOURS.length], () => {
      this.charts.delete(name);
      this.changed();
    });
    this.charts.set(name, chart);
    this.place.append(chart.element);
    this.changed();
  }

  take({ t, values }) {
    for (const [name, value] of Object.entries(values)) this.charts.get(name)?.take(t, value);
  }
}

class Chart {
  constructor(name, unit, colour, remove) {
    Object.assign(this, { colour, unit, points: [], dirty: true });
    this.element = document.createElement("div");
    this.element.className = "chart";
    const head = document.createElement("div");
    head.className = "head";
    const title = document.createElement("b");
    title.textContent = name;
    this.value = document.createElement("output");
    const close = document.createElement("button");
    close.textContent = "×";
    close.title = `Remove ${name}`;
    close.addEventListener("click", () => { this.element.remove(); remove(); });
    head.append(title, this.value, close);
    this.canvas = document.createElement("canvas");
    this.element.append(head, this.canvas);
  }

  take(t, value) {
    const number = typeof value === "boolean" ? Number(value) : value;
    if (this.points.length && t < this.points.at(-1)[0]) this.points = [];
    this.points.push([t, number]);
    while (this.points[0][0] < t - SPAN) this.points.shift();
    this.value.textContent = typeof value === "number" ? `${Number(value.toPrecision(5))} ${this.unit}` : String(value ?? "none");
    this.dirty = true;
  }

  draw() {
    if (!this.dirty || !this.canvas.clientWidth) return;
    this.dirty = false;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (this.canvas.width !== width * ratio) [this.canvas.width, this.canvas.height] = [width * ratio, height * ratio];
    const draw = this.canvas.getContext("2d");
    draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw.clearRect(0, 0, width, height);
    const finite = this.points.filter(([, value]) => Number.isFinite(value));
    if (!finite.length) return;
    const values = finite.map(([, value]) => value);
    const [low, high] = [Math.min(0, ...values), Math.max(0, ...values)];
    const end = this.points.at(-1)[0];
    const x = (t) => width - ((end - t) / SPAN) * width;
    const y = (value) => height - 4 - ((value - low) / (high - low || 1)) * (height - 18);
    const style = getComputedStyle(this.canvas);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    draw.strokeStyle = colour("line");
    draw.beginPath(); draw.moveTo(0, y(0)); draw.lineTo(width, y(0)); draw.stroke();
    draw.fillStyle = colour("dim");
    draw.font = "10px system-ui, sans-serif";
    draw.fillText(String(Number(high.toPrecision(4))), 2, 10);
    if (low < 0) draw.fillText(String(Number(low.toPrecision(4))), 2, height - 6);
    draw.strokeStyle = colour(this.colour);
    draw.lineWidth = 1.5;
    draw.beginPath();
    let pen = false;
    for (const [t, value] of this.points) {
      // What has no number, as a sensor without an echo, is a gap.
      if (!Number.isFinite(value)) { pen = false; continue; }
      if (pen) draw.lineTo(x(t), y(value)); else draw.moveTo(x(t), y(value));
      pen = true;
    }
    draw.stroke();
  }
}
