// The last minute, as it was seen: where everything was, and the values of names.

export const SPAN = 60; // s of simulated time
const LEAST_SPAN = 5;
// While one looks at the past, it is kept longer.
const KEPT = 3;
// By which the arrow keys move the time that is looked at, s.
const KEY_STEP = 0.05;

export class History {
  constructor() {
    this.frames = [];
    this.values = [];
    this.isHeld = false;
  }

  // Everything has a time `t`. A second one at the same time takes the place of the first.
  addFrame(frame) { this.#add(this.frames, frame); }

  addValues(values) { this.#add(this.values, values); }

  // Values of before, those of further names included.
  addPast(values) {
    const end = values.at(-1)?.t ?? 0;
    this.values = [...values, ...this.values.filter((one) => one.t > end)];
  }

  #add(list, item) {
    if (list.length && item.t < list.at(-1).t) list.length = 0;
    if (list.at(-1)?.t === item.t) list.pop();
    list.push(item);
    const oldest = item.t - SPAN * (this.isHeld ? KEPT : 1);
    while (list[0].t < oldest) list.shift();
  }

  get first() { return this.frames[0]?.t ?? 0; }

  get last() { return this.frames.at(-1)?.t ?? 0; }

  // What a slider or a chart that ends there has on its axis of time.
  begin(end) { return Math.min(Math.max(this.first, end - SPAN), end - LEAST_SPAN); }

  frameAt(t) { return at(this.frames, t); }

  valuesAt(t) { return at(this.values, t); }
}

// The last item that is not later than this; the first where all are later.
function at(list, t) {
  let [low, high] = [0, list.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle].t <= t) low = middle + 1; else high = middle;
  }
  return list[Math.max(low - 1, 0)];
}

// A slider over the last minute, with marks for what was active and what went wrong.
export class Timeline {
  constructor(history, { range, marks, shown, live }, changed) {
    Object.assign(this, { history, range, marks, shown, live, changed });
    this.past = null; // the time that is looked at, unless it is now
    this.spans = new Map(); // of steps, by name: from, to, and if it failed
    this.warnings = [];
    this.failures = [];
    range.addEventListener("input", () => this.show(Number(range.value) >= Number(range.max) ? null : Number(range.value)));
    range.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
      if (!way) return;
      event.preventDefault();
      const t = Number(range.value) + way * KEY_STEP;
      this.show(t >= Number(range.max) ? null : t);
    });
    live.addEventListener("click", () => this.show(null));
    setInterval(() => this.draw(), 100);
  }

  // Shows this time, or the present.
  show(t) {
    if (t !== null) t = Math.min(Math.max(t, this.history.first), this.history.last);
    this.past = t;
    this.history.isHeld = t !== null;
    this.draw();
    this.changed(t);
  }

  takeSteps(steps, now) {
    for (const step of steps) {
      if (step.begun_s === null) continue;
      const known = this.spans.get(step.name);
      const span = { from: step.begun_s, to: known?.to ?? null, isFailed: step.state === "failed" };
      // The end of what was over before is not known.
      if (step.state === "active") span.to = null; else span.to ??= known ? now : (step.done_s ?? step.begun_s);
      this.spans.set(step.name, span);
    }
    for (const [name, span] of this.spans) if (span.to !== null && span.to < this.history.first) this.spans.delete(name);
  }

  takeWarning(t) {
    this.warnings.push(t);
    if (this.warnings.length > 1000) this.warnings.splice(0, 500);
  }

  draw() {
    const { range, history } = this;
    const isPast = this.past !== null;
    if (!isPast) {
      range.min = history.begin(history.last).toFixed(3);
      range.max = history.last.toFixed(3);
      range.value = range.max;
    } else range.value = this.past.toFixed(3);
    const t = isPast ? this.past : history.last;
    range.setAttribute("aria-valuetext", `${t.toFixed(3)} s${isPast ? "" : ", live"}`);
    this.live.disabled = !isPast;
    this.live.classList.toggle("on", !isPast);
    this.shown.textContent = isPast ? `${t.toFixed(2)} s` : "now";
    this.#marks(Number(range.min), Number(range.max));
  }

  #marks(from, to) {
    const { marks } = this;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [marks.clientWidth, marks.clientHeight];
    if (!width) return;
    const isSame = marks.width === Math.round(width * ratio) && marks.height === Math.round(height * ratio);
    if (!isSame) [marks.width, marks.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const draw = marks.getContext("2d");
    draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw.clearRect(0, 0, width, height);
    const style = getComputedStyle(marks);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    const x = (t) => ((t - from) / (to - from || 1)) * width;
    let row = 0;
    for (const span of this.spans.values()) {
      if ((span.to ?? to) < from || span.from > to) continue;
      const left = Math.max(x(span.from), 0);
      draw.fillStyle = colour(span.isFailed ? "bad" : "accent");
      draw.fillRect(left, 2 + (row % 3) * 4, Math.max(Math.min(x(span.to ?? to), width) - left, 2), 3);
      row += 1;
    }
    for (const [times, name, thick] of [[this.warnings, "warn", 1], [this.failures, "bad", 2]]) {
      draw.fillStyle = colour(name);
      for (const t of times) if (t >= from && t <= to) draw.fillRect(x(t), 0, thick, height);
    }
  }
}
