// The worker of a page that holds its model: runs of the module, one after another.

const CONTINUES = ["BLOCK_FULL", "PAUSED", "STIFF"];
// A call of the kernel lasts some 10 ms, so that a later request is heard soon.
const MOMENT = 10, FIRST = 16, MOST = 4000, ROWS = 128;

// Lets messages arrive.
const channel = new MessageChannel(), waiting = [];
channel.port1.onmessage = () => waiting.shift()();
const breath = () => new Promise((done) => { waiting.push(done); channel.port2.postMessage(0); });

// One row of each `stride` and the last row, as `run/observers/thinning.py` keeps them.
class Kept {
  constructor(places, most) {
    Object.assign(this, {places, most, stride: 1, count: 0, seen: 0});
    this.rows = new Float64Array(256 * places.length);
  }

  // The last row is the one behind those that are kept.
  add(table, from, width) {
    const {places} = this, wide = places.length;
    if (this.seen && (this.seen - 1) % this.stride === 0 && ++this.count > 2 * this.most) this.thin();
    if ((this.count + 1) * wide > this.rows.length) {
      const more = new Float64Array(2 * this.rows.length);
      more.set(this.rows);
      this.rows = more;
    }
    for (let k = 0, to = this.count * wide; k < wide; k++) this.rows[to + k] = table[from * width + places[k]];
    this.seen++;
  }

  // Halves the rows until there are few enough; the last row stays behind them.
  thin() {
    const {rows, places: {length: wide}} = this, last = rows.slice(this.count * wide, (this.count + 1) * wide);
    while (this.count > this.most) {
      const half = Math.ceil(this.count / 2);
      for (let k = 1; k < half; k++) rows.copyWithin(k * wide, 2 * k * wide, (2 * k + 1) * wide);
      this.count = half;
      this.stride *= 2;
    }
    rows.set(last, this.count * wide);
  }

  // The columns, from the first row to the last.
  get columns() {
    if (this.count > this.most) this.thin();
    const {rows, count, places} = this, wide = places.length;
    return places.map((_, k) => {
      const column = new Float64Array(count + 1);
      for (let i = 0, from = k; i <= count; i++, from += wide) column[i] = rows[from];
      return column;
    });
  }
}

class Running {
  constructor(model, module) {
    this.model = model;
    const [section] = WebAssembly.Module.customSections(module, "lagsim");
    this.about = JSON.parse(new TextDecoder().decode(section));
    this.module = module;
    this.starts = new Start(model);
    this.filming = new Filming(model, this.starts.graph);
  }

  async prepared() {
    const {exports} = await WebAssembly.instantiate(this.module, {});
    this.exports = exports;
    this.numbers = new Float64Array(exports.memory.buffer);
    const {state, parameters, rows} = this.about.places;
    this.image = this.numbers.slice(state / 8, rows / 8);
    this.p = parameters / 8;
    this.s = state / 8;
  }

  // Begins a run at the values of some texts; gives all that is known at its start.
  begin(texts) {
    const {model, numbers, about, s, p} = this, {words, parameters, state} = about;
    numbers.set(this.image, s);
    let known = {...model.base};
    const settings = this.settings(known);
    if (Object.keys(texts).length) {
      known = this.starts.begun(texts, this.settings(this.starts.stated(texts).values).start);
      Object.assign(settings, this.settings(known));
      for (const x of model.parameters) numbers[p + parameters[x.name].word] = known[x.name];
      [...model.kept].forEach((name, k) => { numbers[s + words.y + state.indexOf(name)] = known[name]; });
      this.put(settings);
      this.lengthen(known);
      this.exports.prepare(0, 0, about.places.parameters, 0);
    }
    return {known, settings};
  }

  put({start, end, output_step: step, changed}) {
    if (!changed) return;
    const {numbers, s, about: {words}} = this;
    for (const name of ["t", "row_start", "arc_start"]) numbers[s + words[name]] = start;
    numbers[s + words.row_step] = step;
    numbers[s + words.end] = end;
    const instant = 2 ** -50 * Math.max(Math.abs(end), Math.abs(start));
    numbers[s + words.row_limit] = numbers[s + words.arc_rows] = Math.min(end - instant, end - this.model.sameStep * step);
  }

  settings(known) {
    const {base, steps, rows} = this.model.settings, found = {...base, changed: false};
    if (!steps) return found;
    const at = (key) => key in steps ? valueOf(steps[key], known) : null;
    found.start = at("start") ?? 0;
    found.end = "duration" in steps ? found.start + at("duration") : at("end");
    found.output_step = at("output_step") ?? (found.end - found.start) / rows;
    found.changed = true;
    const length = found.end - found.start;
    if (!(length > 0 && length < Infinity)) throw new Error(`the run from ${found.start} to ${found.end} has no positive, finite length [${this.model.numbers["out-of-range"]}]`);
    if (!(found.output_step > 0 && length / found.output_step < 1e8)) throw new Error(`\`output_step\` is ${found.output_step}: it makes too many rows [${this.model.numbers["out-of-range"]}]`);
    if (length / found.output_step < 1 - this.model.sameStep) throw new Error(`\`output_step\` is ${found.output_step}, longer than the run, ${length} [${this.model.numbers["out-of-range"]}]`);
    return found;
  }

  // Lengths of constraint rows follow from the start, where those of the file do.
  lengthen(known) {
    const {model, numbers, p} = this;
    if (!model.lengths.length) return;
    this.usual ||= this.starts.lengths(model.base) || [];
    const found = this.starts.lengths(known);
    model.lengths.forEach(({value, words}, i) => {
      const follows = found && Math.abs(this.usual[i] - value) <= 1e-9 * value && found[i] > 0;
      if (follows) for (const word of words) numbers[p + word] = found[i];
    });
  }

  // Runs to the end; `seen` receives tables of rows, and ends the run with true. Gives
  // the code of the end, or null for a run that a later request ended.
  async run(seen, ended) {
    const {exports, about, numbers, s} = this, {places, words, codes, columns, block, state} = about;
    const width = columns.length, size = state.length, word = (name) => s + words[name];
    const tabulated = (count) => {
      exports.tabulate(places.rows, BigInt(count), BigInt(size), places.parameters, places.columns, BigInt(width));
      return numbers.subarray(places.columns / 8, places.columns / 8 + count * width);
    };
    let budget = FIRST, last = -Infinity, code, since = performance.now();
    do {
      const left = this.model.mostSteps - numbers[word("steps")], began = performance.now();
      if (left <= 0) { code = "TOO_MANY_STEPS"; break; }
      const asked = Math.min(budget, left);
      code = codes[String(exports.advance(places.state, places.parameters, places.rows, BigInt(Math.min(block, ROWS * asked)), BigInt(asked)))];
      const took = performance.now() - began;
      if (took > 2 * MOMENT) budget = Math.max(1, Math.floor(budget * MOMENT / took));
      else if (took < MOMENT) budget = Math.min(2 * budget, MOST);
      const count = numbers[word("emitted")];
      if (count) {
        const table = tabulated(count);
        last = numbers[places.rows / 8 + (count - 1) * (1 + size)];
        const known = this.finite(count, size);
        if (known && seen(table, known, width)) return "SEEN";
        if (known < count) {
          this.lastRow = Array.from(table.subarray(known * width, (known + 1) * width));
          return "NOT_FINITE";
        }
      }
      const y = numbers.subarray(word("y"), word("y") + this.model.dynamic);
      if (!y.every(Number.isFinite)) code = "NOT_FINITE";
      else if (!(numbers[word("projected")] <= this.model.largestShift)) code = "STATE_JUMPS";
      if (code === "STIFF") { numbers[word("at_bound")] = 0; numbers[word("pause_at")] *= 4; }
      if (performance.now() - since > MOMENT) {
        await breath();
        since = performance.now();
        if (ended()) return null;
      }
    } while (CONTINUES.includes(code));
    const t = numbers[word("t")];
    if (code !== "NOT_FINITE" && !(last >= t)) {
      numbers[places.rows / 8] = t;
      numbers.copyWithin(places.rows / 8 + 1, word("y"), word("y") + size);
      seen(tabulated(1), 1, width);
    }
    return code;
  }

  // The number of rows before the first with a state that is not finite.
  finite(count, size) {
    const {numbers, about: {places}, model} = this;
    for (let k = 0; k < count; k++)
      for (let c = 0; c <= model.dynamic; c++)
        if (!Number.isFinite(numbers[places.rows / 8 + k * (1 + size) + c])) return k;
    return count;
  }

  // The text of a run that has ended early, "" for a complete one.
  failure(code) {
    if (code === "DONE" || code === "SEEN") return "";
    const {numbers, about: {words, places, columns}, model, s} = this, t = numbers[s + words.t];
    const {text, advice, number} = model.failures[code] || model.failures.other;
    const shown = model.stateNames.slice(1, 13).map((name) => `${name} = ${general(this.lastRow[columns.indexOf(name)])}`);
    const more = code in model.failures && model.fallback ? `; ${model.fallback}` : "";
    return `${text.replace("{steps}", numbers[s + words.steps])} at t = ${exactly(t)} (${shown.join(", ")}): ${advice} [${number}]${more}`;
  }

  // The start at some values; where `follow` asks for it, the nearest one that is
  // admissible, with the texts of the start values that have moved there.
  begun(texts, follow) {
    try { return {known: this.begin(texts).known, moved: {}}; } catch (error) {
      if (!follow || !error.repair) throw error;
      return {known: this.begin({...texts, ...error.repair}).known, moved: error.repair};
    }
  }

  async motion(texts, ended, follow) {
    const {model, about} = this, {known, moved} = this.begun(texts, follow);
    const kept = new Kept(model.wanted.map((name) => about.columns.indexOf(name)), model.mostRows);
    this.lastRow = new Array(about.columns.length).fill(NaN);
    const code = await this.run((table, count, width) => {
      for (let k = 0; k < count; k++) kept.add(table, k, width);
      this.lastRow = Array.from(table.subarray((count - 1) * width, count * width));
    }, ended);
    if (code === null) return null;
    const error = this.failure(code);
    if (!kept.seen) throw new Error(error || "the run has no rows");
    const found = Object.fromEntries(kept.columns.map((column, k) => [model.wanted[k], column])), rows = found.t.length;
    const film = this.filming.record(Object.fromEntries(model.parameters.map((x) => [x.name, known[x.name]])), found, rows);
    if (kept.stride > 1) film.notes = [`one of ${kept.stride} rows; positions between are interpolated`];
    const names = model.wanted.slice(0, model.table);
    const values = Object.fromEntries([...model.parameters.map((x) => x.name), ...model.stateNames.slice(1)].map((name) => [name, known[name]]));
    return {
      version: 1, film, columns: names, units: model.units, state: model.stateNames, ends: model.ends, values, moved, error, held: model.rows.length > 0,
      rows, data: Object.fromEntries(names.map((name) => [name, found[name]])),
    };
  }

  // The state at a time of the run, by its own steps and the method's dense output.
  async state(texts, t, ended) {
    const {model, about, numbers, s} = this, {settings} = this.begin(texts), {words, columns} = about;
    const at = Math.min(Math.max(t, settings.start), settings.end);
    numbers[s + words.extras] = numbers[s + words.listed] = 1;
    numbers[s + words.extra] = numbers[s + words.extra_times] = at;
    let found = null;
    this.lastRow = new Array(columns.length).fill(NaN);
    const code = await this.run((table, count, width) => {
      for (let k = 0; k < count; k++) {
        this.lastRow = Array.from(table.subarray(k * width, (k + 1) * width));
        if (this.lastRow[0] === at) { found = this.lastRow; return true; }
      }
      return false;
    }, ended);
    if (code === null) return null;
    if (!found) throw new Error(this.failure(code) || `the run has no state at t = ${at}`);
    return Object.fromEntries(model.stateNames.map((name) => [name, found[columns.indexOf(name)]]));
  }

  async drag(texts, t, point, target, ended) {
    const state = await this.state(texts, t, ended);
    if (state === null) return null;
    // The place is that of the time, the velocities are those of the start.
    const place = Object.fromEntries(this.model.q.map((name) => [name, state[name]]));
    return new ConstrainedStart(this.starts, this.begin(texts).known).dragged(place, point, target);
  }

  // Start values with one set to a value, or near it; unchanged ones are left out.
  start(texts, name, value) {
    const {q, v, rows} = this.model, {known} = this.begin(texts);
    if (!rows.length || ![...q, ...v].includes(name)) return {[name]: value};
    const found = new ConstrainedStart(this.starts, known).put(name, value);
    return Object.fromEntries(Object.entries(found).filter(([x, y]) => y !== known[x] || x === name));
  }

  // The text of the model file with other values.
  file(texts) {
    const {values, at} = this.starts.stated(texts), {text, spans, added} = this.model.file, edits = [], more = [];
    for (const name of new Set([...this.model.overridden, ...Object.keys(texts)])) {
      const value = name in at ? at[name] : values[name], shown = writtenNumber(value);
      if (spans[name] === "shared") throw new Error(`\`${name}\` has no number of its own in the file: \`lagsim explore\` without -o writes it`);
      if (spans[name]) edits.push([...spans[name], shown]);
      else more.push(`${name}: ${shown}`);
    }
    if (more.length && !added) throw new Error(`the file has no place for ${more.join(", ")}`);
    if (more.length) edits.push([added.at, added.at, more.map((x) => x + added.between).join("")]);
    let found = text;
    for (const [from, to, shown] of edits.sort((a, b) => b[0] - a[0])) found = found.slice(0, from) + shown + found.slice(to);
    return found;
  }
}

// A number as Python writes it.
function writtenNumber(x) {
  if (x === Math.round(x) && Math.abs(x) < 1e15) return String(x + 0);
  return String(x).replace(/e([+-])(\d)$/, "e$10$2");
}

// --- Requests: a motion ends the motion and the state before it, a state the state

let running = null;
const latest = {motion: 0, state: 0};
let turn = Promise.resolve();

async function answered({id, kind, values = {}, follow, t, point, target, name, value}) {
  const moves = kind === "motion";
  const ended = () => latest.motion > id || (!moves && latest.state > id);
  if (["motion", "state", "drag"].includes(kind) && ended()) return {};
  if (kind === "motion") return {found: await running.motion(values, ended, follow)};
  if (kind === "state") return {found: await running.state(values, t, ended)};
  if (kind === "drag") return {found: await running.drag(values, t, point, target, ended)};
  if (kind === "start") return {found: running.start(values, name, value)};
  return {found: running.file(values)};
}

async function opened({model, module}) {
  running = new Running(JSON.parse(model), module);
  await running.prepared();
}

self.onmessage = ({data}) => {
  const {id, kind} = data;
  if (kind === "motion") latest.motion = id;
  if (kind === "state" || kind === "drag") latest.state = id;
  turn = turn.then(async () => {
    try {
      const answer = kind === "open" ? await opened(data) : await answered(data);
      self.postMessage({id, ...answer});
    } catch (error) {
      self.postMessage({id, error: error.message});
    }
  });
};
