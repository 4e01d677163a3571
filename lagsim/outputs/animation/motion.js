// What moves: a run's data unpacked, and where everything is at a time.

function unpacked(text, Kind) {
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

class Run {
  constructor(data) {
    Object.assign(this, data);
    this.t = unpacked(data.t, Float64Array);
    this.broken = new Set(data.broken);
    this.points = data.points.map((p) => p.fixed ? p : {
      ...p, place: unpacked(p.place, Float32Array), rate: unpacked(p.rate, Float32Array),
    });
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

  // Positions by Hermite's cubic: right at both frames, and so are the velocities.
  place(k, {i, step, part: s}) {
    const p = this.points[k], d = this.dimension;
    if (p.fixed) return p.fixed;
    const straight = this.broken.has(i), found = [];
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
