// The traffic of a line, decoded, while the panel is open.

import { add, fill, h, show, text } from "./dom.js";
import { choices, labelled, table } from "./fetched.js";
import { clock, number, t, words } from "./texts.js";
import { called } from "./titles.js";

const HEADINGS = ["time", "gap", "kind", "station", "function", "meaning", "bytes"].map((word) => t(`heading.${word}`));
const ROWS_MAX = 500;
const DRAW_MS = 250;
const IN_ORDER = new Set(["request", "reply", "echo"]);

/** The panel of the traffic of a line. */
export class Panel {
  constructor(element) {
    this.line = h("select", { change: () => this.source && this.begin() });
    this.toggle = h("button", { type: "button", class: "plain", click: () => (this.source ? this.end() : this.begin()) }, t("traffic.start"));
    this.pause = h("button", { type: "button", class: "plain", "aria-pressed": "false", click: () => this.set_paused(!this.is_paused) }, t("traffic.pause"));
    this.clear = h("button", { type: "button", class: "plain", click: () => this.empty() }, t("traffic.clear"));
    this.only_faults = h("input", { type: "checkbox" });
    this.message = h("p", { class: "message", role: "status" }, t("traffic.idle"));
    const { element: shown, body, row } = table(t("traffic.title"), HEADINGS, [t("heading.gap")]);
    this.body = body;
    this.row = row;
    this.scroll = h("div", { class: "scroll traffic", tabindex: 0, role: "region", "aria-label": t("traffic.title") }, shown);
    this.source = null;
    this.is_paused = false;
    this.waiting = [];
    this.lost = 0;
    setInterval(() => this.draw(), DRAW_MS);
    document.addEventListener("visibilitychange", () => document.visibilityState === "hidden" && this.end());
    add(
      element,
      h(
        "div",
        { class: "tools" },
        labelled(t("line"), this.line),
        this.toggle,
        this.pause,
        this.clear,
        h("label", { class: "choice" }, this.only_faults, h("span", {}, t("traffic.faults"))),
      ),
      this.message,
      this.scroll,
    );
    show(this.pause, false);
  }

  names(lines) {
    choices(this.line, "lines", lines);
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
    text(this.toggle, t("traffic.end"));
    show(this.pause, true);
    text(this.message, t("traffic.listening", { line: called("lines", line) }));
    source.addEventListener("frame", (event) => this.take(JSON.parse(event.data)));
    source.addEventListener("lost", (event) => {
      this.lost += JSON.parse(event.data).records ?? 0;
    });
    source.onerror = () => {
      if (this.source !== source) return;
      if (source.readyState === EventSource.CLOSED) {
        this.end();
        text(this.message, t("traffic.refused"));
      } else {
        // The browser asks again by itself, from where it was: an answer without an end is ended at times.
        text(this.message, t("traffic.again", { line: called("lines", line) }));
      }
    };
    source.onopen = () => text(this.message, t("traffic.listening", { line: called("lines", line) }));
  }

  end() {
    if (!this.source) return;
    this.source.close();
    this.source = null;
    this.draw();
    text(this.toggle, t("traffic.start"));
    show(this.pause, false);
    text(this.message, t("traffic.ended"));
  }

  set_paused(is) {
    this.is_paused = is;
    this.pause.setAttribute("aria-pressed", String(is));
    text(this.pause, t(is ? "traffic.resume" : "traffic.pause"));
  }

  empty() {
    this.waiting = [];
    fill(this.body);
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
    add(this.body, ...this.waiting.splice(0).map((frame) => this.shown(frame)));
    while (this.body.childElementCount > ROWS_MAX) this.body.firstElementChild.remove();
    if (is_at_end) this.scroll.scrollTop = this.scroll.scrollHeight;
    if (this.source && this.lost > 0) text(this.message, t("traffic.lost", { line: called("lines", this.line.value), count: this.lost }));
  }

  shown(frame) {
    const { at, kind, bytes, gap_ms, station, drive, function: code, text: sentence } = frame;
    const gap = typeof gap_ms === "number" ? `${number(gap_ms, 1)} ms` : "";
    const who = drive ? `${station} ${called("drives", drive)}` : (station ?? "");
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
