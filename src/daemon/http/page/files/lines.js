// A row for each line.

import { announce, attribute, h, keyed, reshape, shape, show, text } from "./dom.js";
import { Hold } from "./hold.js";
import * as session from "./session.js";
import { clock, number, sentence_of, span, t, words } from "./texts.js";
import { called } from "./titles.js";

const rows = new Map();
let place = null;

/** Prepares the rows inside `lines`. */
export function start(lines) {
  place = lines;
}

/** Shows these lines and no others. */
export function replace(lines) {
  keyed(place, rows, lines, (line) => line.name, (line) => new Line(line.name));
  update(lines);
}

/** Shows what is new of some lines. */
export function update(lines) {
  for (const line of lines) rows.get(line.name)?.take(line);
}

class Line {
  constructor(name) {
    /** What people call it; not written anywhere yet. */
    this.shown = null;
    this.title = h("h3");
    this.shape = shape("unknown");
    this.state = h("span", { class: "word" });
    this.about = h("p", { class: "about" });
    this.bar = h("meter", { min: 0, max: 100, high: 85 });
    this.cells = {};
    const cell = (key, label, ...more) => {
      this.cells[key] = h("span", { class: "number" });
      return h("div", {}, h("dt", {}, label), h("dd", {}, this.cells[key], ...more));
    };
    this.suspicion = h("p", { class: "suspicion" });
    this.name = name;
    this.yield = new Hold("", "plain", () => this.hand_over());
    this.how = this.yield.element.title;
    this.result = h("p", { class: "result" });
    this.element = h(
      "article",
      { class: "card line", id: `line-${name}` },
      h("header", {}, this.title, h("p", { class: "state" }, this.shape, this.state)),
      this.about,
      h(
        "dl",
        {},
        cell("use", t("line.use"), this.bar),
        cell("planned", t("line.planned")),
        cell("bad", t("line.bad")),
        cell("rate", t("line.rate")),
        cell("stop", t("line.stop")),
        cell("silent", t("line.silent")),
        cell("seen", t("line.seen")),
      ),
      this.suspicion,
      h("div", { class: "yield" }, this.yield.element, this.result),
    );
  }

  /** The title may change with the configuration. */
  draw_name() {
    const { name } = this;
    const shown = called("lines", name);
    if (shown === this.shown) return;
    this.shown = shown;
    text(this.title, shown);
    attribute(this.title, "title", shown === name ? null : name);
    attribute(this.bar, "aria-label", t("line.use_of", { name: shown }));
    attribute(this.element, "aria-label", t("line.called", { name: shown }));
  }

  take(line) {
    this.draw_name();
    const { state, stop_ms = {} } = line;
    const reason = sentence_of({ said: line.reason_said, text: line.reason });
    const is_up = state === "up";
    attribute(this.element, "data-state", is_up ? (line.is_suspended ? "suspended" : "up") : "down");
    reshape(this.shape, is_up ? "good" : "problem");
    const standby = line.standby ? ` · ${t("line.standby")}: ${words(line.standby.role)}` : "";
    text(this.state, `${words(is_up ? "up" : "down")}${standby}`);
    const link = [line.link, String(line.framing ?? "").toUpperCase()].filter(Boolean).join(" ");
    text(this.about, `${line.port} · ${link} · ${t("drives", { count: line.drives?.length ?? 0 })}`);
    const use = line.use_per_cent;
    this.bar.value = typeof use === "number" ? use : 0;
    text(this.cells.use, `${number(use, 0)} %`);
    text(this.cells.planned, `${number(line.planned_use_per_cent, 0)} %`);
    text(this.cells.bad, line.bad_per_cent === null ? "–" : `${number(line.bad_per_cent)} %`);
    text(this.cells.rate, `${number(line.exchanges_per_s, 1)} /s`);
    text(this.cells.stop, within(stop_ms.all_healthy));
    text(this.cells.silent, within(stop_ms.one_silent));
    text(this.cells.seen, within(stop_ms.longest_seen));
    const suspended = line.is_suspended ? t("line.suspended") : "";
    const suspicion = [is_up ? null : reason, suspended, sentence_of({ said: line.suspicion_said, text: line.suspicion })].filter(Boolean).join(" · ");
    show(this.suspicion, suspicion !== "");
    text(this.suspicion, suspicion);
    show(this.yield.element, line.standby?.role === "active" && session.may_maintain());
    const { partner } = line.standby ?? {};
    this.yield.rename(t("yield", { partner }));
    this.yield.element.title = `${t("yield.first", { partner })} ${this.how}`;
  }

  async hand_over() {
    this.yield.enable(false);
    this.tell("pending", t("command.sent", { command: this.yield.label }));
    const { outcome, message } = await session.hand_over(this.name);
    this.yield.enable(true);
    const said = t(`yield.${outcome}`);
    // What has no sentence stays as the gateway wrote it.
    this.tell(outcome === "handed_over" ? "good" : "bad", said === `yield.${outcome}` ? message : said);
  }

  tell(kind, message) {
    this.result.className = `result ${kind}`;
    text(this.result, `${clock(Date.now())} ${message}`);
    announce(`${this.shown}: ${message}`, kind === "bad");
  }
}

function within(ms) {
  if (typeof ms !== "number") return "–";
  return ms < 10_000 ? `${number(Math.round(ms))} ms` : span(ms);
}
