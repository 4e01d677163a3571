// The page's script on a document that keeps what is said to it, and on canvases that
// keep what is drawn. It answers line by line: {"script", "runs", "steps", "hash", "dark", "size"}.
"use strict";

// What has been drawn since the canvas was cleared: one entry for each stroke, fill or text.
class Pen {
  constructor() {
    Object.assign(this, {drawn: [], path: [], offset: [0, 0], kept: [], dash: [], globalAlpha: 1});
  }
  put(op, more) {
    const {fillStyle, strokeStyle, lineWidth, globalAlpha, dash, textAlign, textBaseline} = this;
    this.drawn.push({op, colour: /^fill/i.test(op) ? fillStyle : strokeStyle, width: lineWidth,
      alpha: globalAlpha, dash, align: textAlign, base: textBaseline, at: this.offset, ...more});
  }
  clearRect() { this.drawn = []; }
  setTransform(...by) { this.transform = by; }
  setLineDash(dash) { this.dash = dash; }
  beginPath() { this.path = []; }
  closePath() { this.path.push(["close"]); }
  save() { this.kept.push([this.offset, this.globalAlpha]); }
  restore() { [this.offset, this.globalAlpha] = this.kept.pop(); }
  translate(x, y) { this.offset = [this.offset[0] + x, this.offset[1] + y]; }
  measureText(text) { return {width: 6 * text.length}; }
  clip() { this.put("clip", {path: this.path}); }
  stroke(shape) { this.put("stroke", {path: shape ? [["shape", shape.shape]] : this.path}); }
  fill(shape) { this.put("fill", {path: shape ? [["shape", shape.shape]] : this.path}); }
  fillRect(...box) { this.put("fillRect", {box}); }
  fillText(text, x, y) { this.put("fillText", {text, x, y}); }
  strokeText(text, x, y) { this.put("strokeText", {text, x, y}); }
}
for (const name of ["moveTo", "lineTo", "arc", "ellipse", "rect", "roundRect", "quadraticCurveTo"])
  Pen.prototype[name] = function (...args) { this.path.push([name, ...args]); };

// What a page shows at first and after each of the steps.
function answer(asked) {
  const SIZES = {line: [700, 66]}, USUAL = asked.size || [600, 400];
  const made = [];
  class Node {
    constructor(tag) {
      Object.assign(this, {tag, attributes: {}, children: [], dataset: {}, heard: {}, classes: new Set(), own: ""});
      this.style = {properties: {}, setProperty(name, value) { this.properties[name] = value; }};
      this.classList = {toggle: (name, on) => on ? this.classes.add(name) : this.classes.delete(name)};
      made.push(this);
    }
    setAttribute(name, value) { this.attributes[name] = String(value); }
    append(...more) { for (const one of more) { if (one instanceof Node) one.parent = this; this.children.push(one); } }
    before(...more) { if (this.parent) this.parent.children.splice(this.parent.children.indexOf(this), 0, ...more); }
    addEventListener(name, act) { (this.heard[name] ||= []).push(act); }
    hear(name, event) { for (const act of this.heard[name] || []) act(event); }
    setPointerCapture() {}
    getContext() { return this.pen ||= new Pen(); }
    get clientWidth() { return (SIZES[this.id] || USUAL)[0]; }
    get clientHeight() { return (SIZES[this.id] || USUAL)[1]; }
    set innerHTML(text) { this.own = text; this.children = []; }
    set textContent(text) { this.own = String(text); this.children = []; }
    get textContent() {
      return this.own.replace(/<[^>]*>/g, "") + this.children.map((c) => c instanceof Node ? c.textContent : c).join("");
    }
  }

  const named = {}, frames = [], outer = {};
  const byName = (id) => named[id] ||= Object.assign(new Node(id), {id});
  byName("runs").own = JSON.stringify(asked.runs);
  const listen = (name, act) => { (outer[name] ||= []).push(act); };
  const document = {
    getElementById: byName, createElement: (tag) => new Node(tag), addEventListener: listen,
    documentElement: new Node("html"), body: new Node("body"), title: "title",
  };
  const location = {hash: asked.hash || ""};
  const world = {
    document, location, window: {devicePixelRatio: asked.ratio || 1}, addEventListener: listen,
    // A colour is its own name.
    getComputedStyle: () => ({getPropertyValue: (name) => ` ${name.slice(2)}`}),
    matchMedia: (query) => ({matches: Boolean(asked.dark) && query.includes("dark"), addEventListener() {}}),
    ResizeObserver: class { observe() {} }, requestAnimationFrame: (act) => frames.push(act),
    Path2D: class { constructor(shape) { this.shape = shape; } }, HTMLButtonElement: class {},
  };
  new Function(...Object.keys(world), `"use strict";\n${asked.script}`)(...Object.values(world));

  const nothing = () => {};
  const ACTS = {
    key: (key, more = {}) => outer.keydown.forEach((act) => act({key, preventDefault: nothing, ...more})),
    click: (id) => byName(id).hear("click", {}),
    frame: (now) => frames.splice(0).forEach((act) => act(now)),
    hash: (text) => { location.hash = text; outer.hashchange.forEach((act) => act({})); },
    on: (canvas, name, event) => canvases()[canvas].hear(name, {preventDefault: nothing, pointerId: 1, ...event}),
  };
  const canvases = () => [...made.filter((n) => n.tag === "canvas"), byName("line")];
  const seen = () => ({
    drawn: canvases().map((canvas) => canvas.getContext("2d").drawn),
    transforms: canvases().map((canvas) => canvas.getContext("2d").transform),
    sizes: canvases().map((canvas) => [canvas.width, canvas.height]),
    titles: canvases().map((canvas) => canvas.title || ""),
    line: byName("line").attributes,
    texts: Object.fromEntries(Object.entries(named).map(([id, node]) => [id, node.textContent])),
    hidden: Object.fromEntries(Object.entries(named).map(([id, node]) => [id, Boolean(node.hidden)])),
    pressed: Object.fromEntries(Object.entries(named).map(([id, node]) => [id, node.attributes["aria-pressed"]])),
    labels: Object.fromEntries(Object.entries(named).map(([id, node]) => [id, node.attributes["aria-label"]])),
    bars: made.filter((n) => n.attributes.class === "bar").map(({children: [label, value, track]}) => ({
      label: label.textContent, value: value.textContent, colour: track.children[0].attributes.style,
      ...track.children[0].style.properties, zero: track.children[1].attributes.style,
    })),
    panels: made.filter((n) => n.attributes.class === "panel").map((n) => ({hidden: Boolean(n.hidden), classes: [...n.classes]})),
    data: {...document.body.dataset}, theme: document.documentElement.dataset.theme,
  });
  const found = [JSON.parse(JSON.stringify(seen()))];
  for (const [act, ...args] of asked.steps) {
    ACTS[act](...args);
    found.push(JSON.parse(JSON.stringify(seen())));
  }
  return found;
}

require("readline").createInterface({input: process.stdin}).on("line", (line) => {
  let said;
  try {
    said = {found: answer(JSON.parse(line))};
  } catch (error) {
    said = {failed: error.stack};
  }
  console.log(JSON.stringify(said));
});
