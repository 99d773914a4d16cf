// The world from above, to scale. All lengths in metres, x to the right, y up.

import { Still } from "./still.js";

const MOST_POINTS = 4000; // of the path of a vehicle
const PATH_STEP = 0.02;
const GRIDS = [0.1, 0.5, 1, 5, 10, 50]; // m
const SLOWEST = 100; // ms between two states, beyond which a vehicle stands rather than crawls on

export class Picture {
  constructor(canvas) {
    this.canvas = canvas;
    this.at = [0, 0]; // what is in the middle
    this.scale = 60; // pixels for a metre
    this.world = { obstacles: [], areas: [], tags: [], strips: [] };
    this.devices = [];
    this.now = null;
    this.past = null; // what is looked at, unless it is now
    this.paths = [];
    this.bumps = [];
    this.show = { rays: true, trails: true, follow: false };
    this.dirty = true;
    this.frames = 0;
    this.every = 1000 / 60; // ms between two states, on average
    this.still = new Still();
    this.#controls();
    new ResizeObserver(() => { this.dirty = true; }).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.dirty = true; this.colours = null; this.still.forget(); });
    const frame = () => {
      if (this.dirty) { this.dirty = this.#draw() < 1; this.frames += 1; }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  setState(state) {
    const first = this.devices.length === 0;
    if (JSON.stringify(state.world) !== JSON.stringify(this.world)) {
      this.world = state.world;
      this.still.forget();
    }
    this.devices = state.devices;
    this.dirty = true;
    if (first) this.wantsFit = true;
  }

  // Where everything is now. It is gone to from where it is shown, in the time that one state lasts.
  setNow(now) {
    if (this.now && now.t < this.now.t) { this.paths = []; this.bumps = []; this.now = null; this.still.forget(); }
    const passed = now.t - (this.now?.t ?? now.t);
    if (this.now && passed === 0) return;
    const arrived = performance.now();
    now.devices.forEach((device, index) => {
      this.#remember(device, index, now.t);
      const angles = this.now?.devices[index].angles;
      device.angles = device.wheels.map((speed, wheel) => (angles?.[wheel] ?? 0) + speed * passed);
    });
    this.bumps = this.bumps.slice(-100);
    this.from = this.now ? this.#shown(arrived).devices : now.devices;
    this.every += 0.1 * (Math.min(arrived - (this.arrived ?? arrived), SLOWEST) - this.every);
    this.arrived = arrived;
    this.now = now;
    this.dirty = true;
    if (this.wantsFit) { this.wantsFit = false; this.fit(); }
  }

  // The path of a vehicle, and where it hits something.
  #remember(device, index, t) {
    const path = (this.paths[index] ??= []);
    const last = path.at(-1);
    if (!last || Math.hypot(device.x - last[0], device.y - last[1]) > PATH_STEP) {
      path.push([device.x, device.y]);
      if (path.length > MOST_POINTS) { path.splice(0, MOST_POINTS / 4); this.still.forget(); }
    }
    if (device.touching && !this.now?.devices[index].touching) this.bumps.push([device.x, device.y, t]);
  }

  // The vehicles between their last state and the one before, and how far they are from that.
  #shown(at) {
    const part = Math.min((at - this.arrived) / this.every, 1);
    const between = (a, b) => a + (b - a) * part;
    const devices = this.now.devices.map((device, index) => {
      const from = this.from[index];
      return {
        ...device,
        x: between(from.x, device.x),
        y: between(from.y, device.y),
        heading: from.heading + Math.atan2(Math.sin(device.heading - from.heading), Math.cos(device.heading - from.heading)) * part,
        angles: device.angles.map((angle, wheel) => between(from.angles[wheel], angle)),
      };
    });
    return { part, devices };
  }

  fit() {
    const points = this.#points();
    const [xs, ys] = [points.map((p) => p[0]), points.map((p) => p[1])];
    const [left, right] = [Math.min(...xs), Math.max(...xs)];
    const [low, high] = [Math.min(...ys), Math.max(...ys)];
    this.at = [(left + right) / 2, (low + high) / 2];
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const most = Math.min(width / (right - left + 1), height / (high - low + 1));
    this.scale = Math.min(Math.max(most, 4), 150);
    this.dirty = true;
  }

  #points() {
    const points = [];
    for (const one of this.world.obstacles) points.push(...one.outline.slice(0, 200));
    for (const one of this.world.strips) points.push(one.from, one.to);
    for (const device of this.now?.devices ?? []) {
      points.push([device.x - 2, device.y - 2], [device.x + 2, device.y + 2]);
    }
    const near = points.filter(([x, y]) => Math.abs(x) < 200 && Math.abs(y) < 200);
    return near.length ? near : [[-3, -3], [3, 3]];
  }

  #controls() {
    const { canvas } = this;
    const pointers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const last = pointers.get(event.pointerId);
      if (!last) return;
      const here = [event.offsetX, event.offsetY];
      const others = [...pointers].filter(([id]) => id !== event.pointerId);
      if (others.length) {
        const [other] = others[0][1] ? [others[0][1]] : [last];
        const far = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]) || 1;
        this.#zoom(far(here) / far(last), other);
      } else {
        this.at = [this.at[0] - (here[0] - last[0]) / this.scale, this.at[1] + (here[1] - last[1]) / this.scale];
        this.dirty = true;
      }
      pointers.set(event.pointerId, here);
    });
    for (const kind of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.#zoom(Math.exp(-event.deltaY / 500), [event.offsetX, event.offsetY]);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const by = 60 / this.scale;
      const moves = { ArrowLeft: [-by, 0], ArrowRight: [by, 0], ArrowUp: [0, by], ArrowDown: [0, -by] };
      const middle = [canvas.clientWidth / 2, canvas.clientHeight / 2];
      if (moves[event.key]) this.at = this.at.map((value, axis) => value + moves[event.key][axis]);
      else if (event.key === "+") this.#zoom(1.25, middle);
      else if (event.key === "-") this.#zoom(0.8, middle);
      else if (event.key === "0") this.fit();
      else return;
      event.preventDefault();
      this.dirty = true;
    });
  }

  #zoom(by, [px, py]) {
    const scale = Math.min(Math.max(this.scale * by, 2), 2000);
    const dx = (px - this.canvas.clientWidth / 2) * (1 / this.scale - 1 / scale);
    const dy = (py - this.canvas.clientHeight / 2) * (1 / this.scale - 1 / scale);
    this.at = [this.at[0] + dx, this.at[1] - dy];
    this.scale = scale;
    this.dirty = true;
  }

  colour(name) {
    this.colours ??= getComputedStyle(this.canvas);
    return this.colours.getPropertyValue(`--${name}`).trim();
  }

  // Draws; returns how far the vehicles are from one state to the next, 0 to 1.
  #draw() {
    const { canvas, show } = this;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const { part, devices } = this.past ? { part: 1, devices: this.past.devices } : this.now ? this.#shown(performance.now()) : { part: 1, devices: [] };
    const chosen = devices[this.chosen ?? 0];
    if (show.follow && chosen) this.at = [chosen.x, chosen.y];
    const zoom = ratio * this.scale;
    this.hair = 1 / this.scale;
    this.grid = GRIDS.find((step) => step * this.scale > 40) ?? 100;
    const draw = canvas.getContext("2d");
    draw.setTransform(1, 0, 0, 1, 0, 0);
    this.still.draw(draw, this, zoom);
    draw.setTransform(zoom, 0, 0, -zoom, canvas.width / 2 - this.at[0] * zoom, canvas.height / 2 + this.at[1] * zoom);
    devices.forEach((device, index) => this.#vehicle(draw, device, this.devices[index], index));
    this.#bumps(draw);
    draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.#ruler(draw, height);
    devices.forEach((device, index) => this.#label(draw, device, this.devices[index], width, height));
    return part;
  }

  #vehicle(draw, device, about, index) {
    if (!about) return;
    draw.save();
    draw.translate(device.x, device.y);
    draw.rotate(device.heading);
    if (this.show.rays) this.#rays(draw, device, about);
    const { length, width } = about.body;
    draw.fillStyle = this.colour("panel");
    draw.strokeStyle = this.colour(device.touching ? "bad" : index === (this.chosen ?? 0) ? "accent" : "ink");
    draw.lineWidth = this.hair * 2;
    about.wheels.forEach((wheel, at) => this.#wheel(draw, wheel, device.angles[at] ?? 0));
    draw.fillStyle = this.colour("panel");
    draw.globalAlpha = 0.75;
    draw.fillRect(-length / 2, -width / 2, length, width);
    draw.globalAlpha = 1;
    draw.strokeRect(-length / 2, -width / 2, length, width);
    // The nose.
    draw.beginPath();
    draw.moveTo(length / 2, 0); draw.lineTo(length / 4, width / 5); draw.lineTo(length / 4, -width / 5);
    draw.closePath();
    draw.fillStyle = draw.strokeStyle;
    draw.fill();
    draw.restore();
  }

  // A wheel from above: marks on its rim run over it as it turns.
  #wheel(draw, wheel, angle) {
    const radius = wheel.length / 2;
    draw.fillStyle = this.colour("ink");
    draw.fillRect(wheel.x - radius, wheel.y - wheel.width / 2, wheel.length, wheel.width);
    draw.fillStyle = this.colour("accent");
    for (let mark = 0; mark < 6; mark += 1) {
      const turned = angle + (mark * Math.PI) / 3;
      if (Math.cos(turned) <= 0) continue;
      const x = wheel.x + radius * Math.sin(turned);
      const thick = 0.16 * radius * Math.cos(turned);
      draw.fillRect(x - thick / 2, wheel.y - wheel.width / 2, thick, wheel.width);
    }
  }

  #rays(draw, device, about) {
    about.sensors.forEach((sensor, at) => {
      const found = device.echoes[at];
      const range = found ?? sensor.range_m;
      draw.beginPath();
      draw.moveTo(sensor.x, sensor.y);
      draw.arc(sensor.x, sensor.y, range, sensor.heading - sensor.opening / 2, sensor.heading + sensor.opening / 2);
      draw.closePath();
      draw.fillStyle = this.colour("ray");
      draw.globalAlpha = found === null ? 0.06 : 0.3;
      draw.fill();
    });
    draw.globalAlpha = 1;
  }

  #bumps(draw) {
    draw.strokeStyle = this.colour("bad");
    draw.lineWidth = this.hair * 2;
    for (const [x, y] of this.bumps) {
      const r = 5 * this.hair;
      draw.beginPath();
      draw.moveTo(x - r, y - r); draw.lineTo(x + r, y + r);
      draw.moveTo(x - r, y + r); draw.lineTo(x + r, y - r);
      draw.stroke();
    }
  }

  #ruler(draw, height) {
    const length = this.grid * this.scale;
    draw.fillStyle = draw.strokeStyle = this.colour("dim");
    draw.lineWidth = 2;
    draw.beginPath();
    draw.moveTo(12, height - 12); draw.lineTo(12 + length, height - 12);
    draw.stroke();
    draw.font = "12px system-ui, sans-serif";
    draw.fillText(`${this.grid} m`, 14, height - 18);
  }

  #label(draw, device, about, width, height) {
    if (!about || this.devices.length < 2) return;
    const x = width / 2 + (device.x - this.at[0]) * this.scale;
    const y = height / 2 - (device.y - this.at[1]) * this.scale;
    draw.fillStyle = this.colour("dim");
    draw.fillText(about.name, x + 8, y - (about.body.width / 2) * this.scale - 8);
  }
}
