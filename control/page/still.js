// Obstacles, ground and paths, on a second canvas: it is drawn again when the map is moved or zoomed;
// otherwise only the paths grow.

const MARGIN = 0.5; // of the picture, on each side, so that following a vehicle seldom leaves it

export class Still {
  constructor() {
    this.canvas = document.createElement("canvas");
    this.seen = null;
  }

  // It has to be drawn again.
  forget() { this.seen = null; }

  // Puts it into a picture, of which a metre is so many pixels.
  draw(draw, picture, zoom) {
    const { width, height } = picture.canvas;
    const { canvas, seen } = this;
    const [x, y] = picture.at;
    const [across, down] = [Math.round(width * MARGIN), Math.round(height * MARGIN)];
    const isSame = seen && seen.zoom === zoom && seen.width === width && seen.height === height && seen.trails === picture.show.trails;
    if (!isSame || Math.abs(x - seen.x) * zoom > across || Math.abs(y - seen.y) * zoom > down) {
      this.seen = { x, y, zoom, width, height, trails: picture.show.trails };
      canvas.width = width + 2 * across;
      canvas.height = height + 2 * down;
      this.#begin(picture, zoom);
      this.drawn = [];
    }
    if (picture.show.trails) this.#extendTrails(picture);
    draw.drawImage(canvas, Math.round((this.seen.x - x) * zoom) - across, Math.round((y - this.seen.y) * zoom) - down);
  }

  #begin(picture, zoom) {
    const { canvas, seen } = this;
    this.context = canvas.getContext("2d");
    this.context.fillStyle = picture.colour("ground");
    this.context.fillRect(0, 0, canvas.width, canvas.height);
    this.context.setTransform(zoom, 0, 0, -zoom, canvas.width / 2 - seen.x * zoom, canvas.height / 2 + seen.y * zoom);
    this.#grid(picture, canvas.width / zoom / 2, canvas.height / zoom / 2);
    this.#ground(picture);
    this.context.fillStyle = picture.colour("wall");
    for (const one of picture.world.obstacles) { this.#path(one.outline); this.context.fill(); }
  }

  #grid(picture, w, h) {
    const { context: draw, seen: { x, y } } = this;
    const step = picture.grid;
    draw.beginPath();
    for (let at = Math.ceil((x - w) / step) * step; at < x + w; at += step) { draw.moveTo(at, y - h); draw.lineTo(at, y + h); }
    for (let at = Math.ceil((y - h) / step) * step; at < y + h; at += step) { draw.moveTo(x - w, at); draw.lineTo(x + w, at); }
    draw.strokeStyle = picture.colour("line");
    draw.lineWidth = picture.hair * 0.6;
    draw.stroke();
  }

  #ground(picture) {
    const { context: draw } = this;
    for (const area of picture.world.areas) {
      draw.globalAlpha = 0.35;
      draw.fillStyle = picture.colour(area.kind === "slope" ? "slope" : "slip");
      this.#path(area.outline);
      draw.fill();
      draw.globalAlpha = 1;
      draw.strokeStyle = draw.fillStyle;
      draw.lineWidth = picture.hair;
      draw.stroke();
    }
    draw.lineCap = "round";
    for (const strip of picture.world.strips) {
      draw.strokeStyle = picture.colour("strip");
      draw.lineWidth = Math.max(2 * strip.radius, picture.hair);
      draw.beginPath(); draw.moveTo(...strip.from); draw.lineTo(...strip.to); draw.stroke();
    }
    draw.fillStyle = picture.colour("tag");
    for (const tag of picture.world.tags) draw.fillRect(tag.x - 0.03, tag.y - 0.03, 0.06, 0.06);
  }

  #path(outline) {
    this.context.beginPath();
    outline.forEach((point, index) => (index ? this.context.lineTo(...point) : this.context.moveTo(...point)));
    this.context.closePath();
  }

  // Draws what the paths have grown by.
  #extendTrails(picture) {
    const { context: draw } = this;
    draw.lineWidth = picture.hair * 1.5;
    draw.strokeStyle = picture.colour("path");
    picture.paths.forEach((path, index) => {
      const from = Math.max((this.drawn[index] ?? 0) - 1, 0);
      if (path.length <= from + 1) return;
      draw.beginPath();
      path.slice(from).forEach((point, at) => (at ? draw.lineTo(...point) : draw.moveTo(...point)));
      draw.stroke();
      this.drawn[index] = path.length;
    });
  }
}
