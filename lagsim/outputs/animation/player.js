// The player: pictures of runs, their clock, buttons and keys, and what they say.

const $ = (name) => document.getElementById(name);
const root = document.documentElement;
// Called with each time that is shown; what takes hold of a point at a pixel.
const shown = [];
let grabbing = () => null;
let runs = [], many = false, panels = [], together = null, span = 0, usual = 1;

function staged(label, runs, view, ...more) {
  const names = runs.flatMap((run) => run.points.map((point) => point.name)).join(", ");
  const canvas = element("canvas", {role: "img", "aria-label": `Motion of ${label}; points: ${names}`});
  const panel = element("section", {class: "panel"}, element("div", {class: "stage"}, canvas), ...more);
  $("panels").append(panel);
  follow(canvas, view, show, (x, y) => grabbing(x, y));
  return {view, panel, canvas};
}

// Shows some runs, side by side.
function open(list) {
  runs = list;
  many = runs.length > 1;
  // What can be compared is shown at one scale.
  const box = many ? common(runs) : null;
  const floor = floorOf(runs);
  const ranges = runs.map(reach);
  const range = [Math.min(...ranges.map(([low]) => low)), Math.max(...ranges.map(([, high]) => high))];
  const most = Math.max(...runs.map((run) => run.usual));
  panels = runs.map((run, k) => {
    const view = new View(box ? {...run, box, floor, usual: most} : run);
    const bars = new Bars(run, box ? range : ranges[k]);
    const made = staged(run.name, [run], view, bars.box);
    if (many) made.canvas.before(element("h2", {}, run.name));
    return {...made, run, bars, drawing: new Drawing(made.canvas, run, view)};
  });
  // All runs in one picture, each in a colour of its own.
  together = box && staged("all runs", runs, new View({...runs[0], box, floor, usual: most}));
  if (together) {
    together.drawings = runs.map((run, k) => new Drawing(together.canvas, run, together.view, k));
    together.titles = runs.map((run) => element("span", {}, run.name));
    together.canvas.before(element("h2", {}, ...together.titles));
  }
  line.load(runs);
  timed();
  state.t = line.start;
}

// Another run in place of the only one: the view and the time that are shown stay.
function replace(run) {
  const [{view, panel, canvas, bars}] = panels;
  // While the new motion fills a good part of the box before, the scale stays, too.
  const box = common([{...run}, {...run, box: view.run.box}]);
  const fits = box && JSON.stringify(box) === JSON.stringify(view.run.box);
  view.load(fits ? {...run, box} : run);
  runs = [run];
  panels = [{view, panel, canvas, run, bars: new Bars(run, reach(run)), drawing: new Drawing(canvas, run, view)}];
  bars.box.replaceWith(panels[0].bars.box);
  line.load(runs);
  timed();
  state.t = Math.min(line.end, Math.max(line.start, state.t));
  describe();
  resize();
}

// The time of the runs and the usual speed.
function timed() {
  span = line.end - line.start;
  usual = span > 0 ? usualSpeed(span) : 1;
}

const line = new TimeLine($("line"), (t) => { pause(); seek(t); });

// A run of seconds is shown as fast as it is; shorter and longer ones in seconds.
function usualSpeed(span) {
  if (span >= 1.5 && span <= 90) return 1;
  const wanted = span / 8, power = 10 ** Math.floor(Math.log10(wanted));
  return power * [1, 2, 5].findLast((m) => m * power <= wanted * 1.0001);
}

const TRAILS = ["fading", "whole", "none"];
const state = {
  t: 0, playing: false, speed: 1, loop: true, trails: 0, forces: true,
  names: false, together: false, rest: 0,
};
let ink = {}, before = null, shownTheme = "light";

function look(theme) {
  shownTheme = theme;
  root.dataset.theme = theme;
  const style = getComputedStyle(root);
  for (const name of ["paper", "card", "ink", "dim", "faint", "grid", "edge", "rod", "ground", "force",
    "accent", "kinetic", "potential", "total", "work", "shadow", "floor"])
    ink[name] = style.getPropertyValue(`--${name}`).trim();
  $("theme").innerHTML = theme === "dark"
    ? '<svg viewBox="0 0 24 24"><path d="M12 7a5 5 0 1 0 0 10a5 5 0 0 0 0-10M11 1h2v4h-2zM11 19h2v4h-2zM1 11h4v2H1zM19 11h4v2h-4zM4.2 5.6l1.4-1.4l2.8 2.8l-1.4 1.4zM15.6 17l1.4-1.4l2.8 2.8l-1.4 1.4zM18.4 4.2l1.4 1.4L17 8.4L15.6 7zM7 15.6L8.4 17l-2.8 2.8l-1.4-1.4z"/></svg>'
    : '<svg viewBox="0 0 24 24"><path d="M20.7 14.4A9 9 0 0 1 9.6 3.3a9 9 0 1 0 11.1 11.1z"/></svg>';
}

function show() {
  const {t} = state, places = {};
  const played = 5 * usual;
  const from = TRAILS[state.trails] === "whole" ? -Infinity : t - Math.min(0.35 * span, played);
  const trails = TRAILS[state.trails] === "none" ? null : {from, fading: state.trails === 0};
  const wishes = {
    trails, forces: state.forces, names: state.names, glow: 0.35 * state.speed, theme: shownTheme, ink,
  };
  panels.forEach(({run, bars, panel, drawing}, k) => {
    const found = (state.together ? together.drawings[k] : drawing).draw(t, wishes);
    run.points.forEach((point, j) => {
      places[many ? `${run.name}/${point.name}` : point.name] = found[j];
    });
    if (state.together) together.titles[k].style.color = together.drawings[k].colour(run.moving[0]);
    else bars.show(run.moment(t));
    panel.classList.toggle("ended", many && t > run.end);
  });
  line.show(t, ink);
  $("clock").innerHTML = "";
  $("clock").append(`t = ${written(t, span / 2000 || 1)} s`);
  if (span > 0) $("clock").append(element("small", {}, ` of ${written(line.end, span / 200)}`));
  document.body.dataset.t = String(t);
  document.body.dataset.points = JSON.stringify(places);
  for (const act of shown) act(t);
}

function seek(t) {
  state.t = Math.min(line.end, Math.max(line.start, t));
  show();
}

function step(now) {
  if (!state.playing) return;
  const passed = before === null ? 0 : Math.min(0.1, (now - before) / 1000);
  before = now;
  if (state.t >= line.end) {
    state.rest += passed;
    if (!state.loop) pause();
    else if (state.rest > 0.8) { state.rest = 0; seek(line.start); }
  } else seek(state.t + passed * state.speed);
  requestAnimationFrame(step);
}

function button() {
  const shape = state.playing ? "M3 1h4v16H3zM11 1h4v16h-4z" : "M4 1l13 8l-13 8z";
  $("play").innerHTML = `<svg viewBox="0 0 18 18"><path d="${shape}"/></svg>`;
  $("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
  $("play").title = state.playing ? "Pause (space)" : "Play (space)";
}

function play() {
  if (state.playing || !(span > 0)) return;
  if (state.t >= line.end) state.t = line.start;
  Object.assign(state, {playing: true, rest: 0});
  before = null;
  button();
  requestAnimationFrame(step);
}

function pause() {
  state.playing = false;
  button();
}

function faster(factor) {
  state.speed = Math.min(64 * usual, Math.max(usual / 256, state.speed * factor));
  const rounded = Number(state.speed.toPrecision(3));
  $("speed").textContent = `${rounded >= 1e-4 ? rounded : rounded.toExponential(1)}×`;
  show();
}

function toggle(name) {
  if (name === "trails") state.trails = (state.trails + 1) % TRAILS.length;
  else state[name] = !state[name];
  const pressed = name === "trails" ? TRAILS[state.trails] !== "none" : state[name];
  $(name).setAttribute("aria-pressed", String(pressed));
  if (name === "together") { arrange(); return; }
  if (name === "trails") $(name).textContent = ["Trails", "Whole path", "No trails"][state.trails];
  show();
}

const fine = () => span / 200;
// Where keys are letters, or move something else.
const FIELDS = "input, select, textarea, summary";
const jump = (t) => { if (t !== undefined) { pause(); seek(t); } };
const KEYS = {
  " ": () => state.playing ? pause() : play(),
  ArrowLeft: (far) => { pause(); seek(state.t - (far ? 10 : 1) * fine()); },
  ArrowRight: (far) => { pause(); seek(state.t + (far ? 10 : 1) * fine()); },
  Home: () => { pause(); seek(line.start); },
  End: () => { pause(); seek(line.end); },
  PageUp: () => jump(line.event(state.t, false)),
  PageDown: () => jump(line.event(state.t, true)),
  "+": () => faster(2), "=": () => faster(2), "-": () => faster(0.5), "_": () => faster(0.5),
  l: () => toggle("loop"), t: () => toggle("trails"), f: () => toggle("forces"), n: () => toggle("names"),
  o: () => { if (together) toggle("together"); },
  0: () => { for (const {view} of [...panels, together].filter(Boolean)) view.reset(); show(); },
};

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target?.matches?.(FIELDS)) return;
  if (event.key === " " && event.target instanceof HTMLButtonElement) return;
  const act = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!act) return;
  event.preventDefault();
  act(event.shiftKey);
});
$("play").addEventListener("click", KEYS[" "]);
$("slower").addEventListener("click", () => faster(0.5));
$("faster").addEventListener("click", () => faster(2));
for (const name of ["loop", "trails", "forces", "names", "together"]) $(name).addEventListener("click", () => toggle(name));
$("theme").addEventListener("click", () => { look(shownTheme === "dark" ? "light" : "dark"); show(); });

// One picture, or one for each run.
function arrange() {
  for (const {panel} of panels) panel.hidden = state.together;
  if (together) together.panel.hidden = !state.together;
  $("panels").classList.toggle("many", many && !state.together);
  resize();
}

function resize() {
  for (const drawing of state.together ? together.drawings : panels.map((panel) => panel.drawing)) drawing.resize();
  line.resize();
  show();
}

function wanted() {
  const found = /[#&]t=([-+.\deE]+)/.exec(location.hash);
  return found && Number.isFinite(Number(found[1])) ? Number(found[1]) : null;
}

function describe() {
  $("title").textContent = document.title;
  $("legend").textContent = "";
  $("description").textContent = many ? "" : runs[0].description;
  for (const {kind, times} of line.marks) {
    const [shape, colour, name] = eventLook(kind);
    const drawn = HOLLOW.has(kind) ? "fill: none; stroke" : "fill";
    const sign = element("span");
    sign.innerHTML = `<svg viewBox="-7 -7 14 14"><path d="${shape}" stroke-width="1.5" style="${drawn}: var(--${colour})"/></svg>`;
    sign.append(`${name} (${times.length})`);
    $("legend").append(sign);
  }
  if (!many && runs[0].energies.kinetic) {
    const sign = element("span");
    sign.innerHTML = '<svg viewBox="0 0 14 14"><path d="M0 12C4 12 4 2 7 2S10 12 14 12Z" style="fill: var(--kinetic)" opacity=".45"/></svg>';
    sign.append("kinetic energy");
    $("legend").append(sign);
  }
  const notes = runs.flatMap((run) => run.notes.map((note) => many ? `${run.name}: ${note}` : note));
  $("notes").textContent = notes.join("; ");
  $("together").hidden = !together;
  $("jumps").hidden = !line.times.length;
  if (together) $("turning").before(Object.assign(element("kbd"), {textContent: "O"}), " one picture; ");
  $("forces").hidden = $("pushing").hidden = !runs.some((run) => run.usual > 0);
  if (runs.some((run) => run.dimension === 3)) $("turning").textContent = "drag to turn";
}

// Shows the runs for the first time: light or dark, at the time of the address, playing.
function begin() {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", () => { look(dark.matches ? "dark" : "light"); show(); });
  look(dark.matches ? "dark" : "light");
  describe();
  button();
  arrange();
  state.speed = usual;
  faster(1);
  // A picture becomes narrower where the numbers beside it become longer.
  const sized = new ResizeObserver(resize);
  for (const part of [$("panels"), ...[...panels, together].filter(Boolean).map(({canvas}) => canvas)]) sized.observe(part);
  addEventListener("hashchange", () => { const t = wanted(); if (t !== null) { pause(); seek(t); } });
  if (wanted() !== null) seek(wanted());
  else if (!matchMedia("(prefers-reduced-motion: reduce)").matches) play();
}
