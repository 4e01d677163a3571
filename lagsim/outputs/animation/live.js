// The engine of a live page: motions by the server that the page comes from.

const BASE = location.pathname.replace(/[^/]*$/, "");
const PAGE = Array.from(crypto.getRandomValues(new Uint8Array(12)), (x) => x.toString(16).padStart(2, "0")).join("");

class Engine {
  async ask(path, body) {
    let answer;
    try {
      answer = await fetch(BASE + path, body && {
        method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify({...body, page: PAGE}),
      });
    } catch {
      throw new Error("the server does not answer: start `lagsim explore` again");
    }
    if (!answer.ok) throw new Error(`refused: ${answer.status} ${answer.statusText}`);
    return answer;
  }

  async told(path, body) {
    const found = await (await this.ask(path, body)).json();
    if (found.error) throw new Error(found.error);
    return found;
  }

  model() { return this.told("model"); }

  async equations() { return (await this.told("equations")).mathml; }

  // A motion: its header, and columns by name. Null: a later one has taken its place.
  async motion(values, follow) {
    const answer = await this.ask("motion", {values, follow});
    if (answer.headers.get("Content-Type").startsWith("application/json")) {
      const found = await answer.json();
      if (found.error) throw new Error(found.error);
      return null;
    }
    const content = await answer.arrayBuffer();
    const long = new DataView(content).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(content, 4, long)));
    const numbers = new Float64Array(content, 4 + long), rows = header.rows;
    header.data = Object.fromEntries(header.columns.map(
      (name, k) => [name, numbers.subarray(k * rows, (k + 1) * rows)]));
    return header;
  }

  async state(values, t) { return (await this.told("state", {values, t})).state; }

  async drag(values, t, point, target) { return (await this.told("drag", {values, t, point, target})).start; }

  // The start with one of its values at a number, and the others on the constraints.
  async start(values, name, value) { return (await this.told("start", {values, name, value})).start; }

  async file(values) {
    const answer = await this.ask("file", {values});
    if (answer.headers.get("Content-Type").startsWith("application/json")) throw new Error((await answer.json()).error);
    return answer.text();
  }

  // Calls `act` when the file has been saved, and `gone` when the server has ended.
  watch(act, gone) {
    const news = new EventSource(BASE + "news");
    news.onmessage = act;
    news.onerror = () => { if (news.readyState === EventSource.CLOSED) gone(); };
  }
}
