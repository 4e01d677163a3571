// Expressions: texts that somebody writes, and the nodes of a model's graph.
//
// Values are those of `lagsim/language/functions.py`: nan or inf outside a domain. No
// text is ever run as code.

const extremum = (better) => (x, y) => better(y, x) || y !== y ? y : x;
const quotient = (x, y) => x / y;
const sinc = (x) => x ? Math.sin(x) / x : 1;
const chosen = (c, x, y) => c ? x : y;

const FUNCTIONS = {
  add: (x, y) => x + y, sub: (x, y) => x - y, mul: (x, y) => x * y, div: quotient,
  neg: (x) => -x, pow: (x, y) => x === 1 ? 1 : Math.pow(x, y),
  lt: (x, y) => x < y, le: (x, y) => x <= y, gt: (x, y) => x > y, ge: (x, y) => x >= y,
  and: (x, y) => x && y, or: (x, y) => x || y, not: (x) => !x,
  sin: Math.sin, cos: Math.cos, tan: Math.tan, asin: Math.asin, acos: Math.acos,
  atan: Math.atan, atan2: Math.atan2, sinh: Math.sinh, cosh: Math.cosh, tanh: Math.tanh,
  asinh: Math.asinh, acosh: Math.acosh, atanh: Math.atanh,
  exp: Math.exp, log: Math.log, log10: Math.log10, sqrt: Math.sqrt, cbrt: Math.cbrt,
  hypot: (x, y) => Math.hypot(x, y), abs: Math.abs,
  min: extremum((a, b) => a < b), max: extremum((a, b) => a > b),
  if: chosen, "smooth.if": chosen, sinc, "smooth.sinc": (x) => Math.sin(x) / x,
  sign: (x) => x > 0 ? 1 : x < 0 ? -1 : x === x ? 0 : NaN,
  heaviside: (x) => x >= 0 ? 1 : x < 0 ? 0 : NaN,
  floor: Math.floor, ceil: Math.ceil, mod: (x, y) => x - y * Math.floor(x / y),
};

// --- Texts

// A number with some digits, as `%.6g` writes it, and in all its digits.
function general(x, digits = 6) {
  if (!Number.isFinite(x)) return Number.isNaN(x) ? "nan" : x > 0 ? "inf" : "-inf";
  const [, power] = x.toExponential(digits - 1).split("e").map(Number);
  if (x === 0 || (power >= -4 && power < digits)) return String(Number(x.toPrecision(digits)));
  return Number(x.toPrecision(digits)).toExponential().replace(/e([+-])(\d)$/, "e$10$2");
}
const exactly = (x) => Number.isInteger(x) && Math.abs(x) < 1e16 ? `${x}.0` : String(x).replace(/e([+-])(\d)$/, "e$10$2");

// What is wrong with a value, with its place.
class Fault extends Error {
  constructor(text, {code = "syntax", at = 0, length = 1, hint = "", source = null} = {}) {
    super(text);
    Object.assign(this, {code, at, length: Math.max(1, length), hint, source});
  }

  // As commands print it: `--set K=2*:1:11: ...`. `numbers` has the numbers of codes.
  shown(name, text, numbers) {
    const before = this.source === "name" ? "--set " : `--set ${name}=`;
    const line = this.source === "name" ? `--set ${name}` : `--set ${name}=${text}`;
    const column = before.length + this.at;
    const lines = [`${line}:1:${column + 1}: ${this.message} [${numbers[this.code]}]`];
    lines.push(`  ${line}`, `  ${" ".repeat(column)}${"^".repeat(this.length)}`);
    if (this.hint) lines.push(`  hint: ${this.hint}`);
    return lines.join("\n");
  }
}

const TOKEN = /(\s+)|((?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(\p{L}[\p{L}\p{N}_]*)|(\*\*|<=|>=|[-+*/^<>])|(\()|(\))|(,)/uy;
const KINDS = ["space", "number", "name", "operator", "open", "close", "comma"];
const JOINING = ["and", "or", "not"];
// Binding powers of operators; unary minus binds weaker than `^`.
const BINARY = {
  or: [1, "or"], and: [2, "and"], "<": [4, "lt"], "<=": [4, "le"], ">": [4, "gt"], ">=": [4, "ge"],
  "+": [5, "add"], "-": [5, "sub"], "*": [6, "mul"], "/": [6, "div"], "^": [8, "pow"], "**": [8, "pow"],
};
const NOT = 3, COMPARES = 4, UNARY = 7, POWER = 8;
// Functions of the language, each with its number of arguments.
const ARITY = Object.fromEntries([
  ..."sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp log log10 sqrt cbrt abs sinc sign heaviside floor ceil".split(" ").map((x) => [x, 1]),
  ..."atan2 hypot min max mod".split(" ").map((x) => [x, 2]), ["if", 3],
]);

function tokensOf(text) {
  const found = [];
  TOKEN.lastIndex = 0;
  while (TOKEN.lastIndex < text.length) {
    const at = TOKEN.lastIndex, match = TOKEN.exec(text);
    if (!match && text[at] === "_") throw new Fault("a name begins with a letter, not with `_`", {code: "name", at, hint: "use letters, digits and `_`"});
    if (!match) throw new Fault(`unexpected character '${String.fromCodePoint(text.codePointAt(at))}'`, {at});
    const k = match.slice(1).findIndex((x) => x !== undefined), word = match[0];
    let kind = KINDS[k];
    if (kind === "space") continue;
    const end = TOKEN.lastIndex;
    if (kind === "number") {
      const tail = /^[\p{L}\p{N}_]+/u.exec(text.slice(end));
      if (tail) throw new Fault(`\`${word + tail[0]}\` is not a number`, {
        code: "number", at, length: (word + tail[0]).length, hint: `a product is written with \`*\`, ${word}*${tail[0]}`});
      if (!Number.isFinite(Number(word))) throw new Fault(`the number ${word} is too large to be finite`, {
        code: "not-finite", at, length: word.length, hint: "the largest is about 1.8e308"});
    }
    if (kind === "name") {
      if (JOINING.includes(word)) kind = "operator";
      else if (/^\s*\(/.test(text.slice(end))) kind = "function";
    }
    found.push({kind, text: word, at});
  }
  found.push({kind: "end", text: "", at: text.length});
  return found;
}

// An expression in postfix: numbers, names, and [operation, number of arguments].
class Parser {
  constructor(text) {
    Object.assign(this, {text, output: [], kinds: [], pending: [], named: []});
    let operand = true;
    for (const token of tokensOf(text)) operand = operand ? this.operand(token) : this.after(token);
    if (this.kinds[0]) throw new Fault("a comparison is allowed only in `if`", {hint: "write if(condition, a, b)"});
  }

  fault(token, text, more = {}) { return new Fault(text, {at: token.at, length: token.text.length, ...more}); }

  operand(token) {
    if (token.kind === "number" || token.kind === "name") {
      this.output.push(token.kind === "number" ? Number(token.text) : token.text);
      if (token.kind === "name") this.named.push(token);
      this.kinds.push(false);
      return false;
    }
    if (token.kind === "function") {
      if (!Object.hasOwn(ARITY, token.text)) throw this.fault(token, `there is no function \`${token.text}\``, {
        code: "unknown-function", hint: "values are made of numbers, parameters, `pi` and the functions of the language"});
      this.pending.push({op: token.text, power: 0, token, arity: 1, call: true, opened: false});
    } else if (token.kind === "open") {
      const top = this.pending.at(-1);
      if (top && top.call && !top.opened) top.opened = true;
      else this.pending.push({op: "(", power: 0, token, arity: 1});
    } else if (token.kind === "operator" && ["+", "-", "not"].includes(token.text)) {
      const [op, power] = {"+": ["+", UNARY], "-": ["neg", UNARY], not: ["not", NOT]}[token.text];
      this.pending.push({op, power, token, arity: 1});
    } else if (token.kind === "end") throw this.fault(token, "the expression ends where a value is expected");
    else throw this.fault(token, `a value is expected before \`${token.text}\``);
    return true;
  }

  after(token) {
    if (token.kind === "operator" && token.text in BINARY) {
      const [power, op] = BINARY[token.text];
      this.reduce(power === POWER ? power + 1 : power, token);
      this.pending.push({op, power, token, arity: 2});
      return true;
    }
    if (token.kind === "close" || token.kind === "comma") {
      this.reduce(1, token);
      const top = this.pending.at(-1);
      if (!top) throw this.fault(token, token.kind === "close" ? "this parenthesis was never opened" : "a comma is allowed only between a function's arguments", {code: token.kind === "close" ? "parenthesis" : "syntax"});
      if (token.kind === "comma") {
        if (!top.call) throw this.fault(token, "a comma is allowed only between a function's arguments");
        top.arity += 1;
        return true;
      }
      this.pending.pop();
      if (top.call) {
        if (top.arity !== ARITY[top.op]) throw this.fault(top.token, `\`${top.op}\` takes ${ARITY[top.op]} argument${ARITY[top.op] > 1 ? "s" : ""}, found ${top.arity}`, {code: "arity"});
        this.take(top, top.op === "if" ? [true, false, false] : Array(top.arity).fill(false));
      }
      return false;
    }
    if (token.kind === "end") {
      this.reduce(1, token);
      if (this.pending.length) throw this.fault(this.pending.at(-1).token, "this parenthesis is never closed", {code: "parenthesis"});
      return false;
    }
    const before = this.text.slice(0, token.at).trimEnd().slice(-12);
    throw this.fault(token, `an operator is expected between \`${before}\` and \`${token.text}\``, {hint: "there is no implicit product: write `*`"});
  }

  reduce(power, token) {
    while (this.pending.length && this.pending.at(-1).power >= power) {
      const top = this.pending.pop();
      if (top.power === COMPARES && power === COMPARES) throw this.fault(token, "comparisons do not chain", {hint: "write a < b and b < c"});
      this.take(top, Array(top.arity).fill(JOINING.includes(top.op)));
    }
  }

  // Applies an operation to the last values, which are conditions or numbers.
  take(top, wanted) {
    const given = this.kinds.splice(this.kinds.length - wanted.length);
    if (given.some((x, k) => x !== wanted[k]))
      throw this.fault(top.token, wanted.includes(true) ? "a comparison is expected here, found a number" : "a comparison is allowed only in `if`", {hint: "such as if(x > 0, 1, 2)"});
    if (top.op !== "+") this.output.push([top.op, wanted.length]);
    this.kinds.push(JOINING.includes(top.op) || ["lt", "le", "gt", "ge"].includes(top.op));
  }
}

// The value of an expression in postfix.
function valueOf(steps, known) {
  const stack = [];
  for (const step of steps) {
    if (typeof step === "number") stack.push(step);
    else if (typeof step === "string") stack.push(step === "pi" ? Math.PI : known[step]);
    else stack.push(FUNCTIONS[step[0]](...stack.splice(stack.length - step[1])));
  }
  return stack[0];
}

// --- Nodes

const CHUNK = 256;

// A node is ["=", number], ["$", name], or an operation with the nodes it applies to,
// which come before it.
class Graph {
  // Groups of nodes with one operation: its name, the number of operands, and all first
  // operands, then all second ones, as differences from one to the next in the file.
  constructor(groups) {
    this.nodes = [];
    let last = 0;
    for (const [op, width, ...given] of groups) {
      const apply = FUNCTIONS[op], count = given.length / width;
      const all = apply ? given.map((x) => last += x) : given;
      for (let k = 0; k < count; k++) {
        const args = range(width).map((c) => all[c * count + k]);
        this.nodes.push({op, args, value: op === "=" ? Number(args[0]) : 0, apply});
      }
    }
    this.cones = new WeakMap();
  }

  // The nodes that some nodes need, in the order of evaluation.
  cone(outputs) {
    let found = this.cones.get(outputs);
    if (found) return found;
    const seen = new Uint8Array(this.nodes.length);
    for (const n of outputs) seen[n] = 1;
    for (let n = seen.length - 1; n >= 0; n--)
      if (seen[n] && this.nodes[n].apply) for (const a of this.nodes[n].args) seen[a] = 1;
    found = [];
    for (let n = 0; n < seen.length; n++) if (seen[n]) found.push(n);
    this.cones.set(outputs, found);
    return found;
  }

  // The values of some nodes, with variables by name.
  at(outputs, known) {
    const at = [];
    for (const n of this.cone(outputs)) {
      const {op, args, value, apply} = this.nodes[n];
      if (op === "=") at[n] = value;
      else if (op === "$") at[n] = known[args[0]];
      else at[n] = apply(at[args[0]], at[args[1]], at[args[2]]);
    }
    return outputs.map((n) => at[n]);
  }

  // The values of some nodes in each of `count` rows: variables are numbers or columns.
  rows(outputs, known, count) {
    const cone = this.cone(outputs), same = [], own = [], varies = [];
    for (const n of cone) {
      const {op, args, value, apply} = this.nodes[n];
      if (op === "=") same[n] = value;
      else if (op === "$") {
        if (typeof known[args[0]] === "number") same[n] = known[args[0]];
        else { own[n] = known[args[0]]; varies[n] = true; }
      } else if (args.some((a) => varies[a])) {
        own[n] = new Float64Array(Math.min(CHUNK, count));
        varies[n] = true;
      } else same[n] = apply(same[args[0]], same[args[1]], same[args[2]]);
    }
    const found = outputs.map((n) => varies[n] ? new Float64Array(count) : new Float64Array(count).fill(same[n]));
    const moving = cone.filter((n) => varies[n]);
    for (let first = 0; first < count; first += CHUNK) {
      const many = Math.min(CHUNK, count - first), here = [];
      for (const n of moving) {
        const {op, args, apply} = this.nodes[n];
        if (op === "$") { here[n] = own[n].subarray(first, first + many); continue; }
        const out = here[n] = own[n], [a, b, c] = args.map((x) => here[x]), [x, y, z] = args.map((k) => same[k]);
        for (let k = 0; k < many; k++) out[k] = apply(a ? a[k] : x, b ? b[k] : y, c ? c[k] : z);
      }
      outputs.forEach((n, i) => { if (varies[n]) found[i].set(here[n].subarray(0, many), first); });
    }
    return found;
  }
}
