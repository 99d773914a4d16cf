// The connection to the simulator: calls, and the stream of events.

export class Refusal extends Error {}

export class Link {
  constructor() {
    const given = new URLSearchParams(location.hash.slice(1)).get("token");
    if (given) sessionStorage.setItem("sim-token", given);
    this.token = given || sessionStorage.getItem("sim-token") || "";
    // The token is not left where it is seen on a screen or copied with the address.
    if (given) history.replaceState(null, "", location.pathname);
  }

  async call(method, path, body) {
    const response = await this.#fetch(path, { method, body: body === undefined ? undefined : JSON.stringify(body) });
    const answer = await response.json();
    if (!response.ok) throw new Refusal(answer.error || `refused with ${response.status}`);
    return answer;
  }

  async #fetch(path, options) {
    try {
      return await fetch(path, { ...options, headers: { Authorization: `Bearer ${this.token}` } });
    } catch {
      throw new Error("the simulator does not answer; a new one prints a new URL");
    }
  }

  // Passes each event on until the stream ends; returns a function that ends it.
  listen(query, take, ended) {
    const aborter = new AbortController();
    this.#read(query, take, aborter.signal).then(
      () => ended(null),
      (error) => { if (!aborter.signal.aborted) ended(error); },
    );
    return () => aborter.abort();
  }

  async #read(query, take, signal) {
    const response = await this.#fetch(`/v1/events?${new URLSearchParams(query)}`, { signal });
    if (!response.ok) throw new Refusal((await response.json()).error);
    const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
    let rest = "";
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      const messages = (rest + value).split("\n\n");
      rest = messages.pop();
      for (const message of messages) {
        const parts = message.match(/^event: (.*)\ndata: (.*)$/);
        if (parts) take(parts[1], JSON.parse(parts[2]));
      }
    }
  }
}
