// From the scene to the screen: equal scale in all directions, zoomed, moved, turned.

class View {
  constructor(run) {
    this.width = this.height = 1;
    this.load(run);
    this.reset();
  }

  // Another run, seen as the one before.
  load(run) {
    this.run = run;
    this.space = run.dimension === 3;
    const spans = run.box.map(([low, high]) => high - low);
    const size = Math.max(0, ...spans);
    const far = Math.max(0, ...run.box.flat().map(Math.abs));
    // A scene at rest has no size of its own.
    const least = size || 0.5 * far || 1;
    this.spans = spans.map((span) => Math.max(span, size ? 0.02 * size : least));
    this.middle = run.box.map(([low, high]) => (low + high) / 2);
    // Where all is at one height, a floor would cut it: only its lines are drawn.
    this.flat = this.space && spans[2] < 0.02 * size;
    this.floor = this.space ? run.floor : null;
    if (this.space) {
      this.step = stepOf(1.2 * Math.max(...this.spans), 10);
      this.ground = [0, 1].map((k) => [
        this.step * Math.floor((this.middle[k] - this.spans[k] / 2) / this.step + 1e-9),
        this.step * Math.ceil((this.middle[k] + this.spans[k] / 2) / this.step - 1e-9),
      ]);
    }
  }

  reset() {
    this.zoom = 1;
    this.shift = [0, 0];
    this.turned = -0.96;
    this.raised = 0.34;
    this.turn(0, 0);
  }

  turn(across, up) {
    this.turned -= across;
    this.raised = Math.min(1.57, Math.max(-1.57, this.raised + up));
    if (!this.space) {
      this.right = [1, 0];
      this.up = [0, 1];
      return;
    }
    const [s, c] = [Math.sin(this.turned), Math.cos(this.turned)];
    const [u, v] = [Math.sin(this.raised), Math.cos(this.raised)];
    this.right = [-s, c, 0];
    this.up = [-u * c, -u * s, v];
    this.towards = [v * c, v * s, u];
  }

  // So many pixels a unit of length, before zooming.
  get fitting() {
    let [across, up] = this.spans;
    if (this.space) {
      const wide = Math.hypot(this.spans[0], this.spans[1]);
      across = wide;
      up = this.spans[2] * Math.cos(0.34) + wide * Math.sin(0.34);
    }
    // Arrows have room beyond the points.
    const size = Math.min(this.width, this.height);
    const edge = this.run.usual ? 0.2 * size : Math.min(64, 0.14 * size);
    const fit = Math.min((this.width - 2 * edge) / across, (this.height - 2 * edge) / up);
    if (!this.space || this.floor === null) return fit;
    // The corners of the floor are seen as well, however it is turned.
    const far = this.ground.map((ends, k) => Math.max(...ends.map((end) => Math.abs(end - this.middle[k]))));
    return Math.min(fit, this.width / (2 * Math.hypot(...far)));
  }

  get scale() { return this.fitting * this.zoom; }

  // Pixels from the left and from the top, and how near.
  at(place) {
    const [x, y, near] = this.along(place.map((value, k) => value - this.middle[k]));
    return [this.width / 2 + this.shift[0] + x, this.height / 2 + this.shift[1] + y, near];
  }

  // A difference of places, in pixels.
  along(vector) {
    const scale = this.scale;
    const dot = (axis) => axis.reduce((sum, a, k) => sum + a * vector[k], 0);
    return [scale * dot(this.right), -scale * dot(this.up), this.space ? dot(this.towards) : 0];
  }

  // What lies at a pixel, in the plane.
  under(px, py) {
    const x = (px - this.width / 2 - this.shift[0]) / this.scale + this.middle[0];
    const y = -(py - this.height / 2 - this.shift[1]) / this.scale + this.middle[1];
    return [x, y];
  }

  // The pixel (px, py) stays where it is.
  enlarge(factor, px, py) {
    const zoom = Math.min(200, Math.max(0.1, this.zoom * factor));
    const by = zoom / this.zoom;
    const x = px - this.width / 2, y = py - this.height / 2;
    this.shift = [x - by * (x - this.shift[0]), y - by * (y - this.shift[1])];
    this.zoom = zoom;
  }

  move(dx, dy) { this.shift = [this.shift[0] + dx, this.shift[1] + dy]; }
}

// A box about all of some runs, each a good part of it; else null.
function common(runs) {
  if (runs.some((run) => run.dimension !== runs[0].dimension || !run.box.length)) return null;
  const box = runs[0].box.map((_, k) => [
    Math.min(...runs.map((run) => run.box[k][0])), Math.max(...runs.map((run) => run.box[k][1])),
  ]);
  const size = (sides) => Math.max(...sides.map(([low, high]) => high - low));
  return runs.every((run) => size(run.box) >= 0.2 * size(box)) ? box : null;
}

// A floor that is below all of some runs, or none.
function floorOf(runs) {
  const floors = runs.map((run) => run.floor);
  return floors.includes(null) ? null : Math.min(...floors);
}

// About so many round steps in a range.
function stepOf(range, count) {
  const rough = range / count, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((m) => m * power >= rough);
}

function written(value, step) {
  if (Math.abs(value) < 1e-9 * step) return "0";
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const size = Math.abs(value);
  if (size >= 1e5 || digits > 5) return value.toExponential(1).replace("e+", "e").replaceAll("-", "−");
  return value.toFixed(digits).replace("-", "−");
}

function short(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const text = size && (size >= 1e5 || size < 1e-3)
    ? value.toExponential(2) : value.toPrecision(4);
  return text.replace("e+", "e").replaceAll("-", "−");
}
