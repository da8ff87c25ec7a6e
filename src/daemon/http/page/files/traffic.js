// What goes over a line, decoded, while somebody looks.

import { clock, h, show, text, words } from "./dom.js";
import { choices, labelled, table } from "./fetched.js";

const HEADINGS = ["Time", "Gap", "Kind", "Station", "Function", "Meaning", "Bytes"];
const ROWS_MAX = 500;
const DRAW_MS = 250;
const IN_ORDER = new Set(["request", "reply", "echo"]);

/** The panel of the traffic of a line. */
export class Traffic {
  constructor(element) {
    this.line = h("select", { change: () => this.source && this.begin() });
    this.toggle = h("button", { type: "button", class: "plain", click: () => (this.source ? this.end() : this.begin()) }, "Start");
    this.pause = h("button", { type: "button", class: "plain", "aria-pressed": "false", click: () => this.set_paused(!this.is_paused) }, "Pause");
    this.clear = h("button", { type: "button", class: "plain", click: () => this.empty() }, "Clear");
    this.only_faults = h("input", { type: "checkbox" });
    this.message = h("p", { class: "message", role: "status" }, "Nothing is recorded while nobody looks.");
    const { element: shown, body, row } = table("Traffic of the line", HEADINGS, ["Gap"]);
    this.body = body;
    this.row = row;
    this.scroll = h("div", { class: "scroll traffic", tabindex: 0, role: "region", "aria-label": "Traffic of the line" }, shown);
    this.source = null;
    this.is_paused = false;
    this.waiting = [];
    this.lost = 0;
    setInterval(() => this.draw(), DRAW_MS);
    document.addEventListener("visibilitychange", () => document.visibilityState === "hidden" && this.end());
    element.append(
      h(
        "div",
        { class: "tools" },
        labelled("Line", this.line),
        this.toggle,
        this.pause,
        this.clear,
        h("label", { class: "choice" }, this.only_faults, h("span", {}, "Only what is wrong")),
      ),
      this.message,
      this.scroll,
    );
    show(this.pause, false);
  }

  names(lines) {
    choices(this.line, lines);
  }

  open() {}

  /** Who looks elsewhere needs no traffic. */
  close() {
    this.end();
  }

  begin() {
    this.end();
    const line = this.line.value;
    if (!line) return;
    const source = new EventSource(`api/v1/lines/${encodeURIComponent(line)}/traffic`);
    this.source = source;
    this.lost = 0;
    this.set_paused(false);
    text(this.toggle, "Stop");
    show(this.pause, true);
    text(this.message, `Listening to ${line}.`);
    source.addEventListener("frame", (event) => this.take(JSON.parse(event.data)));
    source.addEventListener("lost", (event) => {
      this.lost += JSON.parse(event.data).records ?? 0;
    });
    source.onerror = () => {
      if (this.source !== source) return;
      if (source.readyState === EventSource.CLOSED) {
        this.end();
        text(this.message, "The gateway does not show this line now. Too many may be looking.");
      } else {
        // The browser asks again by itself, from where it was: an answer without an end is ended at times.
        text(this.message, `Connecting to ${line} again.`);
      }
    };
    source.onopen = () => text(this.message, `Listening to ${line}.`);
  }

  end() {
    if (!this.source) return;
    this.source.close();
    this.source = null;
    this.draw();
    text(this.toggle, "Start");
    show(this.pause, false);
    text(this.message, "Stopped.");
  }

  set_paused(is) {
    this.is_paused = is;
    this.pause.setAttribute("aria-pressed", String(is));
    text(this.pause, is ? "Go on" : "Pause");
  }

  empty() {
    this.waiting = [];
    this.body.replaceChildren();
  }

  take(frame) {
    if (this.only_faults.checked && IN_ORDER.has(frame.kind) && !is_exception(frame)) return;
    this.waiting.push(frame);
    // While it is paused, what came first is forgotten first.
    if (this.waiting.length > ROWS_MAX) this.waiting.shift();
  }

  draw() {
    if (this.is_paused || this.waiting.length === 0) return;
    const { scrollTop, scrollHeight, clientHeight } = this.scroll;
    const is_at_end = scrollHeight - scrollTop - clientHeight < 40;
    this.body.append(...this.waiting.splice(0).map((frame) => this.shown(frame)));
    while (this.body.childElementCount > ROWS_MAX) this.body.firstElementChild.remove();
    if (is_at_end) this.scroll.scrollTop = this.scroll.scrollHeight;
    if (this.source && this.lost > 0) text(this.message, `Listening to ${this.line.value}. ${this.lost} records came too fast to be shown.`);
  }

  shown(frame) {
    const { at, kind, bytes, gap_ms, station, drive, function: code, text: sentence } = frame;
    const gap = typeof gap_ms === "number" ? `${gap_ms.toFixed(1)} ms` : "";
    const who = drive ? `${station} ${drive}` : (station ?? "");
    const hex = code === null || code === undefined ? "" : code.toString(16).toUpperCase().padStart(2, "0");
    const spaced = (bytes ?? "").replace(/(..)(?!$)/g, "$1 ");
    const meaning = h("span", {}, sentence ?? "");
    const is_wrong = !IN_ORDER.has(kind) || is_exception(frame);
    return this.row([clock(at, true), gap, words(kind), String(who), hex, meaning, h("code", {}, spaced)], is_wrong ? "wrong" : kind);
  }
}

function is_exception({ exception }) {
  return exception !== null && exception !== undefined;
}
