"use strict";
// Unpacks the parts of a page in one file: they are deflated, in base 85.
(() => {
  const DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;.=>?@^_`{|}~";
  const element = (name) => document.getElementById(name);

  // Five digits are four bytes; the last digits may be fewer.
  function decoded(text) {
    const value = new Uint8Array(128), many = Math.ceil(text.length / 5), found = new DataView(new ArrayBuffer(4 * many));
    for (let k = 0; k < 85; k++) value[DIGITS.charCodeAt(k)] = k;
    for (let i = 0, at = 0; i < many; i++) {
      let x = 0;
      for (let k = 0; k < 5; k++, at++) x = 85 * x + (at < text.length ? value[text.charCodeAt(at)] : 84);
      found.setUint32(4 * i, x);
    }
    return new Uint8Array(found.buffer, 0, Math.floor(4 * text.length / 5));
  }

  const inflated = (name) => new Response(
    new Blob([decoded(element(name).textContent)]).stream().pipeThrough(new DecompressionStream("deflate")));

  // The module with its tapes, of which the file has the heads of all instructions and
  // then the fields by columns, as differences whose bytes stand in four planes.
  function restored(buffer, tapes) {
    for (const [first, size] of tapes) {
      const n = size / 4, planes = new Uint8Array(buffer, first, size), words = new Int32Array(n), tape = new Int32Array(n);
      for (let k = 0, last = 0; k < n; k++) {
        const x = planes[k] | planes[n + k] << 8 | planes[2 * n + k] << 16 | planes[3 * n + k] << 24;
        words[k] = last += (x >>> 1) ^ -(x & 1);
      }
      for (let head = 0, to = 0, from = words.indexOf(0) + 1; words[head]; head += 3) {
        const width = words[head + 1], count = words[head + 2];
        for (let k = 0; k < 3; k++) tape[to++] = words[head + k];
        for (let c = 0; c < width; c++) for (let k = 0; k < count; k++) tape[to + k * width + c] = words[from++];
        to += width * count;
      }
      planes.set(new Uint8Array(tape.buffer));
    }
    return buffer;
  }

  const script = (source) => Object.assign(document.createElement("script"), {textContent: source});
  const made = (source) => new Worker(URL.createObjectURL(new Blob([source], {type: "text/javascript"})));
  const compiled = (buffer) => WebAssembly.compile(restored(buffer, JSON.parse(element("module").dataset.tapes)));
  try {
    const source = inflated("worker").text(), parts = window.parts = {
      source, worker: source.then(made), module: inflated("module").arrayBuffer().then(compiled),
      page: inflated("page").json(), content: inflated("content").text(), mathml: () => inflated("mathml").text(),
    };
    // A part that fails is reported where it is awaited.
    for (const part of Object.values(parts)) part.catch?.(() => {});
    inflated("script").text().then((source) => document.body.append(script(source)));
  } catch (error) {
    Object.assign(element("error"), {textContent: `this browser cannot show the page: ${error.message}`, hidden: false});
  }
})();
