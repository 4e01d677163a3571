// What moves: a run's data unpacked, and where everything is at a time.

function unpacked(text, Kind) {
  // Of a page that computes its motions.
  if (typeof text !== "string") return text;
  const bytes = atob(text);
  const array = new Uint8Array(bytes.length);
  for (let i = 0; i < bytes.length; i++) array[i] = bytes.charCodeAt(i);
  const size = Kind.BYTES_PER_ELEMENT;
  const view = new DataView(array.buffer);
  const values = new Kind(array.length / size);
  for (let i = 0; i < values.length; i++)
    values[i] = size === 8 ? view.getFloat64(8 * i, true) : view.getFloat32(4 * i, true);
  return values;
}

// Axes, of the first of them: in the plane the second, in space the third follows.
function upright(own, d) {
  const unit = (v) => { const size = Math.hypot(...v) || 1; return v.map((x) => x / size); };
  const x = unit(own.slice(0, d));
  if (d === 2) return [x, [-x[1], x[0]]];
  const second = own.slice(3), along = x.reduce((sum, a, k) => sum + a * second[k], 0);
  const y = unit(second.map((b, k) => b - along * x[k]));
  return [x, y, [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]];
}

class Run {
  constructor(data) {
    Object.assign(this, data);
    this.t = unpacked(data.t, Float64Array);
    this.broken = new Set(data.broken);
    this.points = data.points.map((p) => p.fixed ? p : {
      ...p, place: unpacked(p.place, Float32Array), rate: unpacked(p.rate, Float32Array),
    });
    const track = (x) => ({...x, [x.fixed ? "fixed" : "place"]: unpacked(x.fixed || x.place, Float32Array)});
    this.shapes = (data.shapes || []).map((s) => ({
      ...s, at: track(s.at), axes: track(s.axes), corners: track(s.corners),
    }));
    this.pushes = data.pushes.map((p) => ({...p, force: unpacked(p.force, Float32Array)}));
    this.energies = Object.fromEntries(Object.entries(data.energies)
      .map(([name, values]) => [name, unpacked(values, Float32Array)]));
    // Pages of earlier versions do not name it.
    if (this.floor === undefined) this.floor = data.box[data.box.length - 1][0];
    this.start = this.t[0];
    this.end = this.t[this.t.length - 1];
    this.moving = this.points.flatMap((p, k) => p.fixed ? [] : [k]);
    // The usual size of a force, of all that the run shows.
    this.usual = Math.max(0, ...this.pushes.map((p) => p.usual));
  }

  // The last frame that is not after t.
  frame(t) {
    let low = 0, high = this.t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.t[middle] <= t) low = middle; else high = middle - 1;
    }
    return low;
  }

  // A frame, how long it is to the next one, and which part of that has passed.
  moment(t) {
    t = Math.min(Math.max(t, this.start), this.end);
    const i = this.frame(t);
    const last = i === this.t.length - 1;
    const step = last ? 0 : this.t[i + 1] - this.t[i];
    return {t, i, step, part: step ? (t - this.t[i]) / step : 0};
  }

  // Positions by Hermite's cubic: right at both frames, and so are the velocities. What
  // has none goes straight.
  place(k, moment) { return this.placed(this.points[k], this.dimension, moment); }

  placed(p, d, {i, step, part: s}) {
    if (p.fixed) return p.fixed;
    const straight = !p.rate || this.broken.has(i), found = [];
    for (let c = 0; c < d; c++) {
      const a = p.place[i * d + c];
      if (!s) { found.push(a); continue; }
      const b = p.place[(i + 1) * d + c];
      if (straight) { found.push(a + s * (b - a)); continue; }
      const u = step * p.rate[i * d + c], v = step * p.rate[(i + 1) * d + c];
      const r = 1 - s;
      found.push(a + s * s * (3 - 2 * s) * (b - a) + s * r * (r * u - s * v));
    }
    return found;
  }

  // The origin of a shape, which goes with its point, and its corners. Its axes are set
  // upright again: between two frames their entries are those of no rotation.
  corners(shape, moment) {
    const d = this.dimension, {corners} = shape;
    const at = shape.carried ? this.place(shape.point, moment) : this.placed(shape.at, d, moment);
    const axes = upright(Array.from(this.placed(shape.axes, d * (d - 1), moment)), d);
    const count = corners.fixed ? corners.fixed.length : corners.place.length / this.t.length;
    const places = this.placed(corners, count, moment), found = [];
    for (let k = 0; k < count; k += d)
      found.push(Array.from(at, (x, c) => axes.reduce((sum, axis, n) => sum + axis[c] * places[k + n], x)));
    return {at, found};
  }

  // A force goes straight from frame to frame; what is out of force does not push.
  force(push, {i, part}) {
    const d = this.dimension, found = [];
    let one = 0, other = 0;
    for (let c = 0; c < d; c++) {
      const a = push.force[i * d + c];
      const b = part ? push.force[(i + 1) * d + c] : a;
      one += Math.abs(a);
      other += Math.abs(b);
      found.push(a + part * (b - a));
    }
    return one && other && found.every(Number.isFinite) ? found : null;
  }

  energy(name, {i, part}) {
    const values = this.energies[name];
    return part ? values[i] + part * (values[i + 1] - values[i]) : values[i];
  }

  // What has happened within the last `span`, and up to t.
  recent(t, span) {
    return this.events.filter((event) => event.t <= t && event.t > t - span);
  }

  // Where a point has been from time `from` on, more densely where frames are rare.
  path(k, from, to) {
    const first = this.moment(from), last = this.moment(to);
    const frames = last.i - first.i + 1;
    const between = Math.max(1, Math.min(24, Math.ceil(300 / frames)));
    const found = [this.place(k, first)];
    for (let i = first.i; i <= last.i; i++) {
      const step = i + 1 < this.t.length ? this.t[i + 1] - this.t[i] : 0;
      const begin = i === first.i ? first.part : 0;
      const end = i === last.i ? last.part : 1;
      if (!step || end === begin) continue;
      for (let m = 1; m <= between; m++) {
        const part = begin + (end - begin) * m / between;
        if (part >= 1) { if (i < last.i) found.push(this.place(k, {i: i + 1, part: 0})); }
        else found.push(this.place(k, {i, step, part}));
      }
    }
    return found;
  }
}
