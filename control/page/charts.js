// Strip charts of chosen names over the last minute of simulated time, all devices that have a name in one.

const COLOURS = 6; // of lines, as --line-1
const STEPS = [1, 2, 5, 10, 20]; // s between two lines of the axis
const LEAST_APART = 56; // pixels between two labels of it
const FOOT = 14; // pixels of the axis of time

export class Charts {
  constructor(place, history, changed) {
    Object.assign(this, { place, history, changed });
    this.charts = new Map();
    this.view = null; // the time that is looked at and the end of the axis then, unless it is now
    const frame = () => { for (const chart of this.charts.values()) chart.draw(this.view); requestAnimationFrame(frame); };
    requestAnimationFrame(frame);
  }

  // The names whose values are wanted.
  get names() { return [...this.charts.values()].flatMap((chart) => chart.series.map((one) => one.name)); }

  // A chart of this name with a line for each of the series: full name, and what to call it.
  add(name, unit, series = [{ name, label: "" }]) {
    if (this.charts.has(name)) return;
    const chart = new Chart(name, unit, series, this.history, () => {
      this.charts.delete(name);
      this.changed();
    });
    this.charts.set(name, chart);
    this.place.append(chart.element);
    this.changed();
  }

  show(view) { this.view = view; this.refresh(); }

  refresh() { for (const chart of this.charts.values()) chart.dirty = true; }
}

class Chart {
  constructor(name, unit, series, history, remove) {
    Object.assign(this, { unit, series, history, dirty: true });
    this.element = document.createElement("div");
    this.element.className = "chart";
    const head = document.createElement("div");
    head.className = "head";
    const title = document.createElement("b");
    title.textContent = name;
    const outputs = document.createElement("span");
    outputs.className = "outputs";
    head.append(title, outputs);
    this.outputs = series.map((one, index) => {
      const output = document.createElement("output");
      output.style.color = `var(--line-${(index % COLOURS) + 1})`;
      outputs.append(output);
      return output;
    });
    const close = document.createElement("button");
    close.textContent = "×";
    close.title = `Remove ${name}`;
    close.setAttribute("aria-label", close.title);
    close.addEventListener("click", () => { this.element.remove(); remove(); });
    head.append(close);
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${name} over the last minute`);
    this.element.append(head, this.canvas);
    new ResizeObserver(() => { this.dirty = true; }).observe(this.canvas);
  }

  get points() { return this.history.values.filter(({ values }) => this.series[0].name in values); }

  draw(view) {
    if (!this.dirty || !this.canvas.clientWidth) return;
    this.dirty = false;
    const { values } = this.history;
    const shown = view ? this.history.valuesAt(view.t) : values.at(-1);
    this.series.forEach(({ name, label }, index) => {
      const value = shown?.values[name];
      if (value === undefined) return;
      const text = typeof value === "number" ? `${Number(value.toPrecision(4))} ${this.unit}` : String(value ?? "none");
      this.outputs[index].textContent = label ? `${label} ${text}` : text;
    });
    const ratio = devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const [across, down] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== across || this.canvas.height !== down) [this.canvas.width, this.canvas.height] = [across, down];
    const draw = this.canvas.getContext("2d");
    draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw.clearRect(0, 0, width, height);
    const style = getComputedStyle(this.canvas);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    const end = view?.end ?? values.at(-1)?.t ?? 0;
    const from = this.history.begin(end);
    const numbers = values.filter(({ t }) => t >= from && t <= end);
    const all = this.series.flatMap(({ name }) => numbers.map((one) => Number(one.values[name])).filter(Number.isFinite));
    let [low, high] = [0, 0];
    for (const value of all) { low = Math.min(low, value); high = Math.max(high, value); }
    const floor = height - FOOT;
    const x = (t) => ((t - from) / (end - from)) * width;
    const y = (value) => floor - 2 - ((value - low) / (high - low || 1)) * (floor - 14);
    draw.font = "11px system-ui, sans-serif";
    this.#axis(draw, colour, { from, end, x, width, height, floor });
    draw.strokeStyle = colour("line");
    draw.lineWidth = 1;
    draw.beginPath(); draw.moveTo(0, y(0)); draw.lineTo(width, y(0)); draw.stroke();
    draw.fillStyle = colour("dim");
    draw.textAlign = "left";
    if (all.length && high !== low) {
      draw.fillText(String(Number(high.toPrecision(4))), 2, 10);
      if (low < 0) draw.fillText(String(Number(low.toPrecision(4))), 2, floor - 4);
    }
    this.series.forEach(({ name }, index) => {
      draw.strokeStyle = colour(`line-${(index % COLOURS) + 1}`);
      draw.lineWidth = 1.5;
      draw.beginPath();
      let pen = false;
      for (const one of numbers) {
        const value = one.values[name];
        // What has no number, as a sensor without an echo, is a gap.
        if (value === null || value === undefined) { pen = false; continue; }
        if (pen) draw.lineTo(x(one.t), y(Number(value))); else draw.moveTo(x(one.t), y(Number(value)));
        pen = true;
      }
      draw.stroke();
    });
    if (view) {
      draw.strokeStyle = colour("ink");
      draw.lineWidth = 1;
      draw.beginPath(); draw.moveTo(x(view.t), 0); draw.lineTo(x(view.t), floor); draw.stroke();
    }
  }

  #axis(draw, colour, { from, end, x, width, height, floor }) {
    const step = STEPS.find((one) => (one / (end - from)) * width >= LEAST_APART) ?? 30;
    draw.textAlign = "center";
    for (let t = Math.ceil(Math.max(from, 0) / step) * step; t <= end; t += step) {
      const at = x(t);
      draw.strokeStyle = colour("line");
      draw.lineWidth = 0.6;
      draw.beginPath(); draw.moveTo(at, 0); draw.lineTo(at, floor); draw.stroke();
      draw.fillStyle = colour("dim");
      const half = draw.measureText(`${t} s`).width / 2;
      if (at - half >= 0 && at + half <= width) draw.fillText(`${t} s`, at, height - 3);
    }
  }
}
