// What is wrong or could be better: the worst and newest first, the same for many drives in one row.

import { add, fill, h, prose, shape, show, text } from "./dom.js";
import * as notify from "./notify.js";
import { outcome_text } from "./session.js";
import { number, sentence_of, t, words } from "./texts.js";
import { called } from "./titles.js";

const NAMES_MAX = 4;
const RANKS = { problem: 0, hint: 1, good: 2 };
/** Before all else: a motor may turn where the gateway does not see it. */
const FIRST = "may_still_run";
/** Where a drive's own name is in a sentence that others share. */
const NAME = "\u0000";

const seen_at = new Map();
let place = null;
let list = null;
let more = null;
let outcome = null;
let heading = null;
let shown = "";

/** Puts it into `element`, which keeps its height whatever is in it; `title` counts the problems. */
export function start(element, title) {
  heading = title;
  place = element;
  outcome = h("div", { class: "outcome", id: "stop-results", role: "group", "aria-label": t("stop_all.outcome"), hidden: true });
  list = h("ul", { class: "advice" });
  add(element, outcome, list);
  more = h("button", { type: "button", class: "link below", hidden: true, click: () => element.scrollBy({ top: element.clientHeight - 16 }) });
  add(element.parentElement, more);
  element.addEventListener("scroll", count_below);
  const watcher = new ResizeObserver(count_below);
  [element, list, outcome].forEach((part) => watcher.observe(part));
}

/** Not every browser shows that there is more below. */
function count_below() {
  const end = place.getBoundingClientRect().bottom + 1;
  const count = [...list.children].filter((row) => row.getBoundingClientRect().bottom > end).length;
  show(more, count > 0);
  text(more, t("advice.below", { count }));
}

/** Shows what the gateway finds; returns how many problems there are. */
export function advise(advice) {
  const rows = folded(advice);
  const urgent = advice.filter(({ severity }) => severity === "problem");
  notify.problems(urgent.map((finding) => [shown_for(finding), sentence_of(finding)].filter(Boolean).join(" ")));
  const problems = rows.filter(({ severity }) => severity === "problem").length;
  const wanted = JSON.stringify(rows);
  if (wanted === shown) return problems;
  shown = wanted;
  fill(list, ...rows.map(row));
  if (rows.length === 0) {
    add(list, h("li", { class: "good" }, shape("good"), h("span", {}, t("advice.none"))));
  }
  text(heading, problems === 0 ? t("advice.title") : `${t("advice.title")} (${number(problems)})`);
  return problems;
}

/** The drive or else the line that a finding concerns, as people call it. */
function shown_for({ drive, line }) {
  return drive ? called("drives", drive) : line && called("lines", line);
}

/** Rows of equal findings, ranked. */
function folded(advice) {
  const rows = new Map();
  const now = performance.now();
  for (const finding of advice) {
    const { severity, sign, line, drive } = finding;
    const sentence = sentence_of(finding);
    const general = drive ? sentence.replaceAll(` ${drive}\``, ` ${NAME}\``) : sentence;
    const key = [severity, sign, drive ? "" : line, general].join("|");
    const row = rows.get(key) ?? { severity, sign, sentence, of: [], at: 0 };
    const own = `${key}|${drive}`;
    if (!seen_at.has(own)) seen_at.set(own, now);
    row.at = Math.max(row.at, seen_at.get(own));
    row.of.push(drive ? { name: shown_for(finding), id: `drive-${drive}` } : line ? { name: shown_for(finding), id: `line-${line}` } : null);
    row.keys = [...(row.keys ?? []), own];
    rows.set(key, row);
  }
  const present = new Set([...rows.values()].flatMap((row) => row.keys));
  for (const key of seen_at.keys()) if (!present.has(key)) seen_at.delete(key);
  // The gateway ranks what it finds; what it ranks equally is shown with the newest first.
  const rank = ({ sign, severity }) => (sign === FIRST ? -1 : RANKS[severity]);
  return [...rows.values()]
    .sort((one, other) => rank(one) - rank(other) || other.at - one.at)
    .map(({ severity, sign, sentence, of }) => ({ severity, sign, sentence, of: of.filter(Boolean) }));
}

function row({ severity, sign, sentence, of }) {
  const kind = severity === "problem" ? "problem" : "advice";
  const first = of.slice(0, NAMES_MAX);
  const names = first.flatMap(({ name, id }, index) => [index > 0 ? ", " : "", h("a", { href: `#${id}` }, name)]);
  const more = of.length > first.length ? ` ${t("advice.more", { count: of.length - first.length })}` : "";
  const place = of.length > 0 ? h("b", {}, ...names, more) : null;
  return h("li", { class: sign === FIRST ? `${kind} first` : kind }, shape(kind), h("span", {}, h("span", { class: "unseen" }, `${words(kind)}: `), place, place ? " " : "", ...prose(sentence)));
}

/** Shows that a stop for all was sent. */
export function stopping() {
  tell(h("p", {}, t("stop_all.sent")));
}

/** Shows how it ended in one row, with the exceptions below; returns the sentence, and the drives that failed. */
export function stopped(told, took_ms) {
  const failed = told.filter(({ outcome: word }) => word !== "acknowledged" && word !== "confirmed");
  const time = t("seconds", { seconds: number(took_ms / 1000, 1) });
  const sentence = t("stop_all.done", { stopped: told.length - failed.length, all: told.length, time });
  const close = h("button", { type: "button", class: "link", click: () => show(outcome, false) }, t("close"));
  const rows = failed.map((answer) => h("li", { class: "bad" }, h("b", {}, called("drives", answer.drive)), ` ${outcome_text(answer)}`));
  const summary = h("p", { class: failed.length === 0 ? "good" : "bad" }, h("b", {}, `${t("action.stop_all")} `), sentence, " ", close);
  tell(summary, rows.length > 0 ? h("ul", {}, ...rows) : null);
  return { sentence, failed };
}

function tell(...parts) {
  fill(outcome, ...parts);
  show(outcome, true);
  outcome.parentElement.scrollTop = 0;
}
