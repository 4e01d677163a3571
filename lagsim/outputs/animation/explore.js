// The page that explores: values, graphs, and what a script may ask of it.

const engine = new Engine();
// What the file says of itself; the motion that is shown; the values that differ from
// the file's, as texts; the exact state at a time of this motion.
let model = null, motion = null, settings = {}, exact = null, version = 0;
const fields = new Map();

// --- Motions

// One motion is computed at a time; of the wishes that come meanwhile the last one counts.
const PATIENT = 120;
let wish = null, running = null;

// `follow`: where the values make the start inadmissible, start values move to the
// nearest ones that are admissible.
function want(values, follow) {
  return new Promise((done, failed) => {
    const others = wish ? wish.others : [];
    wish = {values, follow, others: [...others, {done, failed}]};
    if (!running || performance.now() - running.since > PATIENT) compute();
  });
}

async function compute() {
  const {values, follow, others} = wish;
  const own = running = {since: performance.now()};
  wish = null;
  let found = null, fault = null;
  try { found = await engine.motion(values, follow); } catch (error) { fault = error; }
  if (running === own) running = null;
  // A later motion has taken the place of this one, and answers for it.
  if (!found && !fault) {
    if (wish) wish.others.unshift(...others);
    else if (running) (running.others ||= []).push(...others);
    else for (const {done} of others) done();
  } else {
    const waiting = [...others, ...(own.others || [])];
    if (found && found.error) fault = new Error(found.error);
    if (fault) for (const {failed} of waiting) failed(fault);
    else {
      if (running === null || !wish) take(found, {...values, ...found.moved});
      for (const {done} of waiting) done();
    }
  }
  if (wish && !running) compute();
}

function take(found, values) {
  motion = found;
  // The columns of the graphs may be those of another model: `redraw` chooses again.
  drawn = "";
  settings = values;
  exact = null;
  version++;
  said("");
  const run = new Run(found.film);
  $("panels").hidden = !found.film.points.length && !found.film.shapes.length && !Object.keys(found.film.energies).length;
  if (panels.length) {
    replace(run);
    filled();
    redraw();
    return;
  }
  const t = wanted();
  open([run]);
  begin();
  if (t !== null) seek(t);
  addressed = true;
  filled();
}

// Values for the motion, from the controls; a refused one leaves the motion as it is.
async function tried(values, follow = false) {
  try {
    await want(values, follow);
    if (!state.playing) await settle();
  } catch (error) {
    said(error.message);
    throw error;
  }
}

function said(text) {
  $("error").textContent = text;
  $("error").hidden = !text;
  document.body.classList.toggle("stale", Boolean(text));
  if (text) document.body.dataset.error = text;
  else delete document.body.dataset.error;
}

// The state at the time that is shown, by the run itself and not between its rows.
async function settle() {
  const mine = version, t = state.t;
  const found = await engine.state(settings, t);
  // Nothing is found where a later motion has taken its place.
  if (!found || mine !== version || t !== state.t) return;
  exact = {t, found};
  if (!drawn) redraw();
  show();
}

// --- The state that is shown

// The name of a rate: `q_dot.3` of `q.3`.
const rateOf = (name) => name.replace(/^[^.]*/, "$&_dot");

function between(t) {
  const times = motion.data.t, last = times.length - 1;
  let low = 0, high = last;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle; else high = middle - 1;
  }
  const next = Math.min(low + 1, last), step = times[next] - times[low];
  const s = step > 0 ? (t - times[low]) / step : 0, found = {};
  for (const name of motion.state) {
    const x = motion.data[name], a = x[low], b = x[next], rate = motion.data[rateOf(name)];
    found[name] = s === 0 ? a : a + s * (b - a);
    if (s > 0 && rate) {
      const u = step * rate[low], v = step * rate[next], r = 1 - s;
      found[name] = a + s * s * (3 - 2 * s) * (b - a) + s * r * (r * u - s * v);
    }
  }
  return {...found, t};
}

shown.push((t) => {
  if (!motion) return;
  const found = exact && exact.t === t ? exact.found : between(t);
  document.body.dataset.state = JSON.stringify(found);
  linked(t);
  if (drawn === shownTheme) cursors(t);
  else if (drawn) redraw();
  else afterMotion();
});

// --- The address holds the settings and, while paused, the time

let addressed = false;

function linked(t) {
  if (!addressed) return;
  if (state.playing && t !== line.start) return;
  const parts = Object.entries(settings).map(([name, text]) => `${encodeURIComponent(name)}=${encodeURIComponent(text)}`);
  if (t !== line.start) parts.push(`t=${t}`);
  const hash = parts.length ? `#${parts.join("&")}` : "";
  if (hash === location.hash) return;
  // The frame of a notebook has no address of its own.
  try { history.replaceState(null, "", location.pathname + hash); } catch { addressed = false; }
}

function asked() {
  const found = {};
  for (const part of location.hash.slice(1).split("&")) {
    const [name, text] = part.split("=").map((x) => { try { return decodeURIComponent(x); } catch { return ""; } });
    if (name && text && name !== "t") found[name] = text;
  }
  return found;
}

// --- Sliders and fields

function digits(value) {
  return Number.isFinite(value) ? String(Number(value.toPrecision(6))) : "";
}

// More sliders than these are closed at first on a phone.
const FEW = 8;

function sliders() {
  const narrow = matchMedia("(max-width: 620px)").matches;
  $("sliders").textContent = "";
  fields.clear();
  for (const [title, start] of [["Parameters", false], ["Start", true]]) {
    const own = model.sliders.filter((x) => x.start === start);
    if (!own.length) continue;
    const box = element("details", {}, element("summary", {}, `${title} (${own.length})`), ...own.map(slider));
    box.open = opened[title] ?? !(narrow && own.length > FEW);
    box.addEventListener("toggle", () => { opened[title] = box.open; });
    $("sliders").append(box);
  }
}
const opened = {};

function slider(x) {
  const id = `value-${x.name}`, own = withSubscripts(x.name);
  const about = x.start ? `start of ${own}` : own, unit = element("small", {}, x.unit);
  const label = element("label", {for: id, title: x.description || about}, own, " ", unit);
  const text = element("input", {type: "text", id, name: x.name, autocomplete: "off", spellcheck: "false"});
  const range = element("input", {type: "range", name: x.name, step: x.whole ? "1" : "any", "aria-label": about});
  text.addEventListener("change", () => chosen(x.name, text.value));
  range.addEventListener("input", () => {
    text.value = digits(Number(range.value));
    if (x.start && motion?.held) slid(x.name, Number(text.value)); else chosen(x.name, text.value, !x.start);
  });
  const row = element("div", {class: "value"}, label, text, x.fixed ? element("small", {}, `fixed: ${x.fixed}`) : range);
  if (x.fixed) text.disabled = true;
  fields.set(x.name, {x, text, range, row, unit});
  return row;
}

// A start value that slides takes the others with it on the constraints. One request at
// a time: the last value counts.
let sliding = null;
async function slid(name, value) {
  const busy = sliding;
  sliding = {name, value};
  if (busy) return;
  while (sliding) {
    const {name, value} = sliding;
    try { await began(await engine.start(settings, name, value)); } catch (error) { said(error.message); }
    if (sliding && sliding.name === name && sliding.value === value) sliding = null;
  }
}

// The motion from other start values.
const began = (found) => tried(
  {...settings, ...Object.fromEntries(Object.entries(found || {}).map(([name, x]) => [name, String(x)]))});

function chosen(name, text, follow = false) {
  const values = {...(wish ? wish.values : settings), [name]: text.trim()};
  if (!text.trim()) delete values[name];
  const {text: field} = fields.get(name);
  tried(values, follow).then(() => field.removeAttribute("aria-invalid"), () => field.setAttribute("aria-invalid", "true"));
}

// The controls show the values of the motion, but for the one that somebody moves.
function filled() {
  for (const [name, {x, text, range, row, unit}] of fields) {
    row.hidden = motion.values[name] === undefined;
    unit.textContent = x.unit || motion.units[name] || "";
    const [low, high] = motion.ends[name] || [x.low, x.high], value = motion.values[name];
    const least = Math.min(low, value), most = Math.max(high, value);
    if (range.min !== String(least) || range.max !== String(most)) Object.assign(range, {min: least, max: most});
    if (document.activeElement !== range) range.value = value;
    // What slides on constraints need not reach the value of the slider.
    const reached = x.start && motion.held;
    if (document.activeElement !== text && (reached || document.activeElement !== range))
      text.value = settings[name] !== undefined && Number.isNaN(Number(settings[name])) ? settings[name] : digits(value);
    text.removeAttribute("aria-invalid");
  }
}

$("reset").addEventListener("click", () => { document.activeElement?.blur?.(); tried({}).catch(() => {}); });
$("file").addEventListener("click", async () => {
  try {
    const content = await engine.file(settings);
    const link = element("a", {href: `data:application/yaml;charset=utf-8,${encodeURIComponent(content)}`, download: `${model.name}.yaml`});
    link.click();
  } catch (error) { said(error.message); }
});

// --- A point that is dragged while the motion is paused

const NEAR = 16;

// The moving point at a pixel, with its place; null where there is none.
function pointAt(px, py) {
  const [{view, run}] = panels, moment = run.moment(state.t);
  let best = null, least = NEAR;
  for (const k of run.moving) {
    const at = run.place(k, moment), [x, y] = view.at(at), far = Math.hypot(x - px, y - py);
    if (far < least) { least = far; best = {name: run.points[k].name, at}; }
  }
  return best;
}

grabbing = (px, py) => {
  if (state.playing || !motion) return null;
  const [{view}] = panels, best = pointAt(px, py);
  if (!best) return null;
  let from = [px, py], {at} = best, busy = false, last = null;
  const [start, values] = [state.t, settings];
  const next = async () => {
    const target = last;
    last = null;
    busy = true;
    try {
      const found = await engine.drag(values, start, best.name, target) || {};
      state.t = line.start;
      await tried({...values, ...Object.fromEntries(Object.entries(found).map(([name, x]) => [name, String(x)]))});
    } catch (error) { said(error.message); }
    busy = false;
    if (last) next();
  };
  return (x, y) => {
    const [dx, dy] = [x - from[0], y - from[1]];
    if (Math.hypot(dx, dy) === 0) return;
    from = [x, y];
    at = at.map((c, k) => c + (dx * view.right[k] - dy * view.up[k]) / view.scale);
    last = at;
    if (!busy) next();
  };
};

$("panels").addEventListener("pointermove", (event) => {
  if (event.target instanceof HTMLCanvasElement && !event.buttons)
    event.target.style.cursor = !state.playing && motion && pointAt(event.offsetX, event.offsetY) ? "move" : "";
});

// --- Graphs

let columns = [], [across, up] = ["", ""], drawn = "";

const withUnit = (name) => withSubscripts(name) + (motion.units[name] ? ` (${motion.units[name]})` : "");

// Columns that tell most: a coordinate that goes to and fro, and another one that is
// seen at its scale.
const ALIKE = 10;
function telling(own) {
  const extent = (name) => { const [low, high] = ends(motion.data[name]); return high - low; };
  const fro = (name) => {
    const [low, high] = ends(motion.data[rateOf(name)] || [0]), [least, most] = [Math.abs(low), Math.abs(high)];
    return low < 0 && high > 0 && Math.min(least, most) > 0.1 * Math.max(least, most);
  };
  const places = motion.state.filter((name) => own.includes(rateOf(name)));
  const first = places.find(fro) || places[0] || motion.state.find((name) => own.includes(name)) || own[0];
  const size = extent(first), other = places.find((name) => name !== first &&
    extent(name) < ALIKE * size && ALIKE * extent(name) > size);
  return other ? [first, other] : [first];
}

function columnsOf() {
  const own = motion.columns.filter((name) => name !== "t");
  if (!columns.length || !columns.every((name) => own.includes(name))) columns = telling(own);
  if (!own.includes(across) || !own.includes(up)) {
    across = columns[0];
    up = own.includes(rateOf(across)) ? rateOf(across) : own[1] || own[0];
  }
  const options = (names, chosen) => names.map((name) => {
    const option = element("option", {value: name}, withSubscripts(name));
    option.selected = name === chosen;
    return option;
  });
  const fill = (id, list) => { $(id).textContent = ""; $(id).append(...list); };
  fill("column", [element("option", {value: ""}, "add…"), ...options(own.filter((name) => !columns.includes(name)), "")]);
  fill("across", options(own, across));
  fill("up", options(own, up));
  $("chosen").textContent = "";
  columns.forEach((name, k) => {
    const chip = element("button", {type: "button", title: "Remove", "aria-label": `Remove ${name}`}, withUnit(name));
    chip.style.borderColor = COLOURS[shownTheme][k % 6];
    chip.addEventListener("click", () => { if (columns.length > 1) { columns.splice(k, 1); redraw(); } });
    $("chosen").append(chip);
  });
}

$("column").addEventListener("change", (event) => { columns = [...columns, event.target.value].slice(-6); redraw(); });
$("across").addEventListener("change", (event) => { across = event.target.value; redraw(); });
$("up").addEventListener("change", (event) => { up = event.target.value; redraw(); });

const ends = (...lists) => {
  let low = Infinity, high = -Infinity;
  for (const list of lists) for (const x of list) if (Number.isFinite(x)) { low = Math.min(low, x); high = Math.max(high, x); }
  if (!(low <= high)) return [0, 1];
  const room = 0.06 * (high - low) || 0.5 * Math.abs(low) || 1;
  return [low - room, high + room];
};

// A canvas with axes: what is drawn there once, and a cursor above it.
class Graph {
  constructor(canvas) {
    this.canvas = canvas;
    this.still = document.createElement("canvas");
    // Before the first drawing no columns are chosen.
    new ResizeObserver(() => { if (drawn) { this.draw(); this.cursor(state.t); } }).observe(canvas);
  }

  draw() {
    const {canvas, still} = this, ratio = window.devicePixelRatio || 1;
    [this.width, this.height] = [Math.max(60, canvas.clientWidth), Math.max(60, canvas.clientHeight)];
    for (const one of [canvas, still]) Object.assign(one, {width: this.width * ratio, height: this.height * ratio});
    const pen = this.pen = still.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    canvas.getContext("2d").setTransform(ratio, 0, 0, ratio, 0, 0);
    this.curves();
  }

  // Axes and grid; the units of both directions.
  scale(x, y, [along, unit]) {
    const {pen, width, height} = this, left = 52, low = 20;
    const [a, b] = x, [c, d] = y;
    this.x = (v) => left + (width - left - 8) * (v - a) / (b - a);
    this.y = (v) => 6 + (height - low - 6) * (d - v) / (d - c);
    this.back = (px) => a + (b - a) * (px - left) / (width - left - 8);
    pen.font = "11px system-ui, sans-serif";
    pen.lineWidth = 1;
    pen.strokeStyle = ink.grid;
    pen.fillStyle = ink.dim;
    const steps = (from, to, count, act) => {
      const step = stepOf(to - from, count);
      for (let k = Math.ceil(from / step); k * step <= to; k++) act(k * step, step);
    };
    pen.textAlign = "center";
    pen.textBaseline = "alphabetic";
    steps(a, b, Math.max(2, width / 90), (v, step) => {
      const px = Math.round(this.x(v)) + 0.5;
      pen.beginPath(); pen.moveTo(px, 6); pen.lineTo(px, height - low); pen.stroke();
      const text = written(v, step);
      pen.fillText(text, within(pen, text, px, width), height - 6);
    });
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    steps(c, d, Math.max(2, height / 38), (v, step) => {
      const py = Math.round(this.y(v)) + 0.5;
      pen.beginPath(); pen.moveTo(left, py); pen.lineTo(width - 8, py); pen.stroke();
      pen.fillText(written(v, step), left - 5, py);
    });
    pen.textAlign = "left";
    if (unit) pen.fillText(unit, 4, height - 7);
    pen.textAlign = "right";
    if (along) pen.fillText(along, width - 10, height - low - 8);
  }

  curve(xs, ys, colour) {
    const {pen} = this;
    pen.strokeStyle = colour;
    pen.lineWidth = 1.6;
    pen.lineJoin = "round";
    pen.beginPath();
    let gap = true;
    for (let k = 0; k < xs.length; k++) {
      const px = this.x(xs[k]), py = this.y(ys[k]);
      if (!Number.isFinite(px + py)) { gap = true; continue; }
      if (gap) pen.moveTo(px, py); else pen.lineTo(px, py);
      gap = false;
    }
    pen.stroke();
  }

  show(act) {
    const pen = this.canvas.getContext("2d");
    pen.clearRect(0, 0, this.width, this.height);
    pen.drawImage(this.still, 0, 0, this.width, this.height);
    act(pen);
  }
}

const COLUMNS_OF = (names) => names.map((name) => motion.data[name]);
const dot = (pen, x, y, colour) => {
  if (!Number.isFinite(x + y)) return;
  pen.beginPath();
  pen.fillStyle = colour;
  pen.arc(x, y, 4.5, 0, 7);
  pen.fill();
};
const rowOf = (t) => {
  const times = motion.data.t;
  let low = 0, high = times.length - 1;
  while (low < high) { const middle = (low + high + 1) >> 1; if (times[middle] <= t) low = middle; else high = middle - 1; }
  const next = Math.min(low + 1, times.length - 1), step = times[next] - times[low];
  return (name) => {
    const x = motion.data[name];
    return step > 0 ? x[low] + (t - times[low]) / step * (x[next] - x[low]) : x[low];
  };
};

class OverTime extends Graph {
  curves() {
    const units = new Set(columns.map((name) => motion.units[name] || ""));
    this.scale([line.start, line.end], ends(...COLUMNS_OF(columns)), ["s", units.size === 1 ? [...units][0] : ""]);
    columns.forEach((name, k) => this.curve(motion.data.t, motion.data[name], COLOURS[shownTheme][k % 6]));
  }

  cursor(t) {
    const value = rowOf(t);
    this.show((pen) => {
      pen.strokeStyle = ink.accent;
      pen.beginPath(); pen.moveTo(this.x(t), 4); pen.lineTo(this.x(t), this.height - 20); pen.stroke();
      columns.forEach((name, k) => dot(pen, this.x(t), this.y(value(name)), COLOURS[shownTheme][k % 6]));
    });
  }
}

class Portrait extends Graph {
  curves() {
    this.scale(ends(motion.data[across]), ends(motion.data[up]), [across, up].map((name) => motion.units[name] || ""));
    this.curve(motion.data[across], motion.data[up], ink.accent);
  }

  cursor(t) {
    const value = rowOf(t);
    this.show((pen) => dot(pen, this.x(value(across)), this.y(value(up)), ink.force));
  }
}

const graphs = [new OverTime($("graph")), new Portrait($("portrait"))];

// The first graphs follow the first picture of the motion.
let follows = false;
function afterMotion() {
  if (follows) return;
  follows = true;
  requestAnimationFrame(() => setTimeout(() => { if (!drawn) redraw(); }));
}

function redraw() {
  drawn = shownTheme;
  columnsOf();
  for (const graph of graphs) graph.draw();
  cursors(state.t);
}

function cursors(t) {
  for (const graph of graphs) if (graph.pen) graph.cursor(t);
}

$("graph").addEventListener("pointerdown", (event) => { $("graph").setPointerCapture(event.pointerId); pause(); seek(graphs[0].back(event.offsetX)); });
$("graph").addEventListener("pointermove", (event) => { if (event.buttons) seek(graphs[0].back(event.offsetX)); });

$("equations").addEventListener("toggle", async () => {
  const box = $("equations").querySelector("div");
  if (!$("equations").open || box.dataset.version === String(model.version)) return;
  box.textContent = "…";
  try {
    box.innerHTML = await engine.equations();
    box.dataset.version = String(model.version);
  } catch (error) { box.textContent = error.message; }
});

// --- What scripts may ask

let turn = Promise.resolve();
const inTurn = (act) => { const found = turn.then(act); turn = found.catch(() => {}); return found; };

window.lagsim = {
  // The state at a time, once it is shown.
  advance: (t) => inTurn(async () => {
    if (!Number.isFinite(t)) throw new Error("a time is a number");
    pause();
    seek(t);
    await settle();
    return JSON.parse(document.body.dataset.state);
  }),
  // Values by name, numbers or expressions, beside the others.
  set: (values) => inTurn(async () => {
    const texts = Object.entries(values).map(([name, x]) => [name, typeof x === "number" ? String(x) : x]);
    const odd = texts.find(([, x]) => typeof x !== "string");
    if (odd) {
      said(`the value of \`${odd[0]}\` is no number and no expression`);
      throw new Error(document.body.dataset.error);
    }
    await tried({...settings, ...Object.fromEntries(texts)});
    await settle();
  }),
};

// --- Begin

async function read() {
  model = await engine.model();
  document.title = model.name;
  sliders();
}

async function saved() {
  const before = model.version;
  await read();
  if (model.fault) { said(model.fault); filled(); return; }
  const known = new Set(model.sliders.map((x) => x.name));
  const kept = Object.fromEntries(Object.entries(settings).filter(([name]) => known.has(name)));
  if (before === model.version && motion) { said(""); filled(); return; }
  await tried(kept).catch(() => tried({}).catch(() => {}));
}

(async () => {
  try {
    await read();
    const first = asked();
    try { await tried(first); } catch (error) {
      if (!Object.keys(first).length) throw error;
      await tried({});
      said(error.message);
    }
  } catch (error) { said(error.message); }
  engine.watch(() => saved().catch((error) => said(error.message)),
    () => said("the server has ended: start `lagsim explore` again"));
})();
