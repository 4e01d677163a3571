// What stands around a picture: energies, the time line, the mouse.

const ENERGIES = {
  kinetic: ["kinetic", "kinetic"], potential: ["potential", "potential"],
  lagrangian: ["lagrangian", "potential"], energy: ["energy", "total"], work: ["work", "work"],
};

// Shape and colour of each kind of event; what it is called.
const EVENTS = {
  impact: ["M-4-5H4L0 4Z", "force", "impact"],
  contact: ["M-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0Z", "work", "contact"],
  release: ["M-3.4 0a3.4 3.4 0 1 0 6.8 0a3.4 3.4 0 1 0-6.8 0", "potential", "release"],
  stick: ["M-3.5-3.5H3.5V3.5H-3.5Z", "total", "stick"],
  slip: ["M0-5L4.5 0L0 5L-4.5 0Z", "kinetic", "slip"],
  zeno: ["M0-5L4 4H-4Z", "total", "at rest"],
  switch: ["M0-5V5", "dim", "switch"],
  event: ["M0-5V5", "total", "event"],
  rank: ["M-3.5-3.5L3.5 3.5M3.5-3.5L-3.5 3.5", "force", "loss of rank"],
};
const HOLLOW = new Set(["release", "switch", "event", "rank"]);
// From one mark of a kind to the next, in pixels: of strokes, and of shapes, which are
// wider. Thousands would be a black band.
const TICKS_APART = 5, MARKS_APART = 10;
const eventLook = (kind) => EVENTS[kind] || ["M0-5V5", "dim", kind];

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// An energy that stays so many times as far from 0 as any of them changes is shown about
// its start, as in energy.png.
const FAR = 10;
function starts({energies}) {
  const ends = {};
  let moving = 0;
  for (const [name, values] of Object.entries(energies)) {
    const end = ends[name] = [Infinity, -Infinity];
    for (const value of values)
      if (Number.isFinite(value)) { end[0] = Math.min(end[0], value); end[1] = Math.max(end[1], value); }
    if (end[0] <= end[1]) moving = Math.max(moving, end[1] - end[0]);
  }
  const found = {};
  for (const [name, [low, high]] of Object.entries(ends)) {
    const far = low <= high && Math.min(Math.abs(low), Math.abs(high)) > FAR * moving;
    found[name] = far && moving > 0 ? energies[name][0] : 0;
  }
  // What is added to T or V is added to T + V.
  const {kinetic, potential, energy} = energies;
  if (kinetic && potential && Math.abs(kinetic[0] + potential[0] - energy[0]) <= 1e-5 * Math.abs(energy[0]))
    found.energy = found.kinetic + found.potential;
  return found;
}

// The least and the greatest energy of a run about its start, or 0.
function reach(run) {
  let low = 0, high = 0;
  const from = starts(run);
  for (const [name, values] of Object.entries(run.energies))
    for (const value of values)
      if (Number.isFinite(value)) {
        low = Math.min(low, value - from[name]);
        high = Math.max(high, value - from[name]);
      }
  return [low, high];
}

class Bars {
  constructor(run, [low, high]) {
    this.run = run;
    this.starts = starts(run);
    this.box = element("aside", {class: "side", "aria-label": "Energies"});
    [this.low, this.span] = [low, high - low || 1];
    this.bars = Object.keys(run.energies).filter((name) => name in ENERGIES).map((name) => {
      // Without T and V, L is the first curve of energy.png.
      const first = name === "lagrangian" && !run.energies.kinetic;
      const [label, own] = ENERGIES[name], colour = first ? "kinetic" : own;
      const value = element("span"), bar = element("i", {style: `background: var(--${colour})`});
      const zero = element("u", {style: `--zero: ${-100 * this.low / this.span}%`});
      const track = element("div", {class: "track", "aria-hidden": "true"}, bar, zero);
      this.box.append(element("div", {class: "bar"},
        element("b", {}, label), value, track));
      return {name, value, bar};
    });
  }

  show(moment) {
    const part = (value) => 100 * Math.min(1, Math.max(0, (value - this.low) / this.span));
    const unit = this.run.units.energy || "";
    for (const {name, value, bar} of this.bars) {
      const now = this.run.energy(name, moment);
      const above = now - this.starts[name];
      const [from, to] = [part(Math.min(0, above)), part(Math.max(0, above))];
      bar.style.setProperty("--from", `${from}%`);
      bar.style.setProperty("--long", `${to - from}%`);
      // Of what is rounding beside the others no digit counts.
      const shown = Math.abs(now) < 1e-9 * this.span ? 0 : now;
      value.textContent = `${short(shown)} ${unit}`.trim();
    }
  }
}

// Where the middle of a text is, at x or as near as it is whole.
function within(pen, text, x, width) {
  const half = pen.measureText(text).width / 2 + 2;
  return Math.max(half, Math.min(width - half, x));
}

class TimeLine {
  constructor(canvas, seek) {
    Object.assign(this, {canvas, runs: [], start: 0, end: 0});
    this.pen = canvas.getContext("2d");
    const follow = (event) => seek(this.time(event.offsetX));
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      follow(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) follow(event);
      canvas.title = this.about(event.offsetX);
    });
  }

  load(runs) {
    this.runs = runs;
    this.start = Math.min(...runs.map((run) => run.start));
    this.end = Math.max(...runs.map((run) => run.end));
    const horizons = runs.map((run) => run.horizon).filter((t) => t !== null);
    this.horizon = horizons.length ? Math.min(...horizons) : null;
    this.marks = Object.keys(EVENTS).concat("").flatMap((kind) => {
      const found = runs.flatMap((run) => run.events)
        .filter((e) => kind ? e.kind === kind : !(e.kind in EVENTS));
      return found.length ? [{kind: kind || found[0].kind, times: found.map((e) => e.t).sort((a, b) => a - b)}] : [];
    });
    this.canvas.setAttribute("aria-valuemin", this.start);
    this.canvas.setAttribute("aria-valuemax", this.end);
    this.times = [...new Set(runs.flatMap((run) => run.events.map((e) => e.t)))].sort((a, b) => a - b);
  }

  // What has happened at a place of the line: the nearest events.
  about(x) {
    const found = this.runs.flatMap((run) => run.events).filter((e) => Math.abs(this.x(e.t) - x) < 5);
    const lines = found.slice(0, 5).map((e) => `t = ${short(e.t)} s: ${eventLook(e.kind)[2]} ${e.what}`);
    return [...lines, ...(found.length > 5 ? [`and ${found.length - 5} more`] : [])].join("\n");
  }

  // The event before a time, or after it.
  event(t, after) {
    const least = 1e-9 * (this.end - this.start);
    return after ? this.times.find((other) => other > t + least)
      : this.times.findLast((other) => other < t - least);
  }

  x(t) { return 12 + (this.width - 24) * (t - this.start) / (this.end - this.start || 1); }

  time(x) {
    const part = Math.min(1, Math.max(0, (x - 12) / (this.width - 24)));
    return this.start + part * (this.end - this.start);
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.width = Math.max(60, this.canvas.clientWidth);
    this.height = this.canvas.clientHeight || 66;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  show(t, ink) {
    const {pen, height} = this, level = height - 25;
    pen.clearRect(0, 0, this.width, height);
    if (this.runs.length === 1) this.energy(this.runs[0], level, ink);
    if (this.horizon !== null) this.unknown(level, ink);
    const bar = (from, to, colour) => {
      pen.fillStyle = colour;
      pen.beginPath();
      pen.roundRect(this.x(from), level - 3, Math.max(1, this.x(to) - this.x(from)), 6, 3);
      pen.fill();
    };
    bar(this.start, this.end, ink.edge);
    bar(this.start, t, ink.accent);
    this.ticks(level, ink);
    for (const {kind, times} of this.marks) this.mark(kind, times, level, ink);
    pen.fillStyle = ink.accent;
    pen.strokeStyle = ink.paper;
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(this.x(t), level, 8, 0, 7);
    pen.fill();
    pen.stroke();
    this.canvas.setAttribute("aria-valuenow", t);
    this.canvas.setAttribute("aria-valuetext", `t = ${short(t)} s`);
  }

  // How much of the energy is in motion, behind all the rest.
  energy(run, level, ink) {
    const values = run.energies.kinetic;
    if (!values) return;
    let most = 0;
    for (const value of values) if (value > most && value < Infinity) most = value;
    if (!most) return;
    const {pen} = this, high = level - 12;
    pen.fillStyle = ink.kinetic;
    pen.globalAlpha = 0.22;
    pen.beginPath();
    pen.moveTo(this.x(run.start), level);
    for (let x = 12; x <= this.width - 12; x++) {
      const from = run.frame(this.time(x - 0.5)), to = run.frame(this.time(x + 0.5));
      let top = values[from];
      for (let i = from; i <= to; i++) if (values[i] > top) top = values[i];
      if (Number.isFinite(top)) pen.lineTo(x, level - high * top / most);
    }
    pen.lineTo(this.x(run.end), level);
    pen.fill();
    pen.globalAlpha = 1;
  }

  unknown(level, ink) {
    const {pen} = this, from = this.x(this.horizon), to = this.x(this.end);
    pen.save();
    pen.beginPath();
    pen.rect(from, 2, to - from, level - 2);
    pen.clip();
    pen.strokeStyle = ink.ground;
    pen.globalAlpha = 0.35;
    pen.lineWidth = 1;
    for (let x = from - level; x < to; x += 7) {
      pen.beginPath();
      pen.moveTo(x, level);
      pen.lineTo(x + level, 0);
      pen.stroke();
    }
    pen.restore();
    pen.fillStyle = ink.dim;
    pen.font = "11px system-ui, sans-serif";
    pen.textBaseline = "top";
    pen.textAlign = from > this.width / 2 ? "right" : "left";
    pen.fillText("no forecast from here on", from + (from > this.width / 2 ? -5 : 5), 3);
  }

  ticks(level, ink) {
    const {pen} = this, span = this.end - this.start;
    if (!(span > 0)) return;
    const step = stepOf(span, Math.max(2, Math.min(12, this.width / 80)));
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "top";
    pen.fillStyle = ink.dim;
    const final = Math.floor(this.end / step + 1e-9);
    for (let k = Math.ceil(this.start / step - 1e-9); k <= final; k++) {
      const x = this.x(k * step), text = written(k * step, step) + (k === final ? " s" : "");
      pen.fillRect(Math.round(x), level + 5, 1, 4);
      pen.fillText(text, within(pen, text, x, this.width), level + 11);
    }
  }

  mark(kind, times, level, ink) {
    const [shape, colour] = eventLook(kind), {pen} = this, path = new Path2D(shape);
    pen.fillStyle = pen.strokeStyle = ink[colour];
    pen.lineWidth = 1.5;
    const apart = shape === "M0-5V5" ? TICKS_APART : MARKS_APART;
    let before = -Infinity;
    for (const t of times) {
      const x = this.x(t);
      if (x - before < apart) continue;
      before = x;
      pen.save();
      pen.translate(x, level - 11);
      if (HOLLOW.has(kind)) pen.stroke(path); else pen.fill(path);
      pen.restore();
    }
  }
}

// Drag moves the plane and turns the space; wheel and two fingers zoom. `grab` returns
// what follows a pointer that has taken something, else null.
function follow(canvas, view, redraw, grab = () => null) {
  const fingers = new Map();
  let taken = null;
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return {apart: Math.hypot(a[0] - b[0], a[1] - b[1]), x: (a[0] + b[0]) / 2, y: (a[1] + b[1]) / 2};
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    taken = fingers.size === 1 ? grab(event.offsetX, event.offsetY) : null;
  });
  canvas.addEventListener("pointermove", (event) => {
    if (taken && fingers.has(event.pointerId)) { taken(event.offsetX, event.offsetY, false); return; }
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const was = fingers.size === 2 ? spread() : null;
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (was) {
      const now = spread();
      view.enlarge(now.apart / (was.apart || 1), was.x, was.y);
      view.move(now.x - was.x, now.y - was.y);
    } else {
      const dx = event.offsetX - before[0], dy = event.offsetY - before[1];
      if (view.space && !event.shiftKey) view.turn(dx * 0.008, dy * 0.008);
      else view.move(dx, dy);
    }
    redraw();
  });
  for (const name of ["pointerup", "pointercancel"])
    canvas.addEventListener(name, (event) => {
      if (taken && fingers.delete(event.pointerId)) taken(event.offsetX, event.offsetY, true);
      fingers.delete(event.pointerId);
      taken = null;
    });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    view.enlarge(Math.exp(-0.0015 * event.deltaY), event.offsetX, event.offsetY);
    redraw();
  }, {passive: false});
  canvas.addEventListener("dblclick", () => { view.reset(); redraw(); });
}
