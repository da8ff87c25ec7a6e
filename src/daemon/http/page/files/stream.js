// The way to the gateway: its events, and whether it is still there.

// The gateway says twice a second that it is there.
const LOST_AFTER_MS = 5000;
const RETRY_MS = 1000;
// A hidden tab gives its connection back: a browser has few of them for one host, and a stop needs one.
const HIDDEN_MS = 10_000;

/** Listens to the gateway's events for as long as the page is open. */
export class Stream {
  /** `on` gets the documents by the name of their event, and `connection` with a state word. */
  constructor(on) {
    this.on = on;
    this.source = null;
    this.state = "connecting";
    this.heard = performance.now();
    this.heard_at = null;
    this.hidden = null;
    this.retry = null;
    document.addEventListener("visibilitychange", () => this.seen());
    window.addEventListener("online", () => this.again());
    setInterval(() => this.watch(), 500);
    this.open();
  }

  open() {
    clearTimeout(this.retry);
    this.retry = null;
    this.source?.close();
    const source = new EventSource("api/v1/events");
    this.source = source;
    let was_opened = false;
    for (const name of ["state", "update", "trip", "configuration", "alive"]) {
      source.addEventListener(name, (event) => {
        if (this.source !== source) return;
        was_opened = true;
        this.hear(name, event.data);
      });
    }
    source.onopen = () => {
      was_opened = true;
    };
    source.onerror = () => {
      if (this.source !== source) return;
      // A browser's own attempts end for good at some answers, so they are made here.
      this.close();
      if (!was_opened) this.lose();
      this.retry = setTimeout(() => this.open(), RETRY_MS);
    };
  }

  close() {
    this.source?.close();
    this.source = null;
  }

  again() {
    if (this.hidden === null && this.state !== "live") this.open();
  }

  hear(name, data) {
    let document = null;
    try {
      document = JSON.parse(data || "{}");
    } catch {
      return;
    }
    this.heard = performance.now();
    this.heard_at = Date.now();
    // Until the whole state has come, what is shown is that of before.
    if (name === "state") this.become("live");
    if (this.state === "live") this.on[name]?.(document);
  }

  watch() {
    if (this.hidden !== null) {
      if (this.source && performance.now() - this.hidden > HIDDEN_MS) {
        this.close();
        clearTimeout(this.retry);
        this.become("connecting");
      }
      return;
    }
    if (performance.now() - this.heard > LOST_AFTER_MS) {
      this.heard = performance.now();
      this.lose();
      this.open();
    }
  }

  seen() {
    if (document.visibilityState === "hidden") {
      this.hidden = performance.now();
      return;
    }
    this.hidden = null;
    if (!this.source) {
      this.heard = performance.now();
      this.open();
    }
  }

  lose() {
    if (this.state !== "lost") this.become("lost");
  }

  become(state) {
    if (this.state === state) return;
    this.state = state;
    this.on.connection(state, this.heard_at);
  }
}
