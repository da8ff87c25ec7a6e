// What a line says about itself: what is good, what is not, and how fast its drives answer.

import { add, fill, h, prose, shape, show, text } from "./dom.js";
import { choices, document_at, labelled, table } from "./fetched.js";
import * as session from "./session.js";
import { number, sentence_of, t, words } from "./texts.js";
import { called } from "./titles.js";

const EVERY_MS = 5000;
const NAMED = ["drive", "answers_to"].map((word) => t(`heading.${word}`));
const COUNTED = ["station", "count"].map((word) => t(`heading.${word}`));
const TIMES = ["p50", "p90", "p99", "p99.9", ...["longest", "timeout", "suggested"].map((word) => t(`heading.${word}`))];
const HEADINGS = [NAMED[0], COUNTED[0], NAMED[1], COUNTED[1], ...TIMES];
const NUMERIC = HEADINGS.filter((heading) => !NAMED.includes(heading));
const SHAPES = { good: "good", hint: "advice", problem: "problem" };

/** The panel of the line's report. */
export class Panel {
  constructor(element) {
    this.element = element;
    this.line = h("select", { change: () => this.load() });
    this.message = h("p", { class: "message", role: "status" });
    this.verdict = h("ul", { class: "advice" });
    this.rates = h("dl", { class: "rates" });
    const { element: shown, body, row } = table(t("report.times"), HEADINGS, NUMERIC);
    this.body = body;
    this.row = row;
    this.is_open = false;
    this.pack = h("button", { type: "button", class: "plain", click: () => this.save() }, t("report.save"));
    session.changed(() => show(this.pack, session.may_maintain()));
    show(this.pack, session.may_maintain());
    add(
      element,
      h("div", { class: "tools" }, labelled(t("line"), this.line), this.pack),
      this.message,
      this.verdict,
      this.rates,
      h("div", { class: "scroll" }, shown),
    );
    setInterval(() => this.is_open && document.visibilityState === "visible" && this.load(), EVERY_MS);
  }

  names(lines) {
    choices(this.line, "lines", lines);
  }

  open() {
    this.is_open = true;
    this.load();
  }

  close() {
    this.is_open = false;
  }

  /** A support archive. Making it takes as long as the traffic is recorded. */
  async save() {
    this.pack.disabled = true;
    text(this.pack, t("report.recording"));
    const wrong = await session.diagnostics();
    this.pack.disabled = false;
    text(this.pack, t("report.save"));
    if (wrong !== null) text(this.message, wrong);
  }

  async load() {
    const line = this.line.value;
    if (!line) return;
    if (!this.body.hasChildNodes()) text(this.message, t("loading"));
    const { answer, error } = await document_at(`api/v1/lines/${encodeURIComponent(line)}/report`, this.element);
    if (line !== this.line.value) return;
    if (!answer) {
      text(this.message, error);
      return;
    }
    const reason = answer.reason ? `: ${sentence_of({ said: answer.reason_said, text: answer.reason })}` : "";
    const observed = t("report.observed", { seconds: number(answer.observed_s, 0) });
    text(this.message, [`${words(answer.state)}${reason}`, answer.link, observed].filter(Boolean).join(" · "));
    fill(
      this.verdict,
      ...answer.verdict.map((finding) => {
        const { severity } = finding;
        const about = [h("span", { class: "unseen" }, `${words(severity)}: `), ...prose(sentence_of(finding))];
        return h("li", { class: severity }, shape(SHAPES[severity]), h("span", {}, ...about));
      }),
    );
    fill(this.rates, ...Object.entries(answer.rates ?? {}).map(([key, value]) => rate(key, value)));
    fill(this.body, ...answer.drives.flatMap((drive) => cells(drive).map((cells_of_one) => this.row(cells_of_one))));
  }
}

function rate(key, value) {
  const is_part = key.endsWith("_per_mille");
  const label = words(key.replace("_per_mille", ""));
  const told = is_part && typeof value === "number" ? `${number(value / 10)} %` : number(value);
  return h("div", {}, h("dt", {}, label), h("dd", {}, told));
}

/** A row for each kind of answer. */
function cells({ name, station, replies = [] }) {
  const ms = (value) => (typeof value === "number" ? `${number(Math.round(value * 10) / 10)} ms` : "–");
  if (replies.length === 0) return [[called("drives", name), String(station), t("report.no_answer")]];
  return replies.map((of) => [
    called("drives", name),
    String(station),
    words(of.class),
    number(of.count),
    ms(of.p50_ms),
    ms(of.p90_ms),
    ms(of.p99_ms),
    ms(of.p999_ms),
    ms(of.max_ms),
    ms(of.timeout_ms),
    ms(of.suggested_timeout_ms),
  ]);
}
