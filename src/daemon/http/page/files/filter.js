// Which drives are shown: all, those in one state, on one line or in one group, or those whose name or model has a word.

import { add, attribute, fill, h, show } from "./dom.js";
import * as drives from "./drives.js";
import { number, t } from "./texts.js";
import { called } from "./titles.js";

/** A motor that may run unseen is counted before all else. */
const UNSEEN = "may_still_run";
const COUNTED = [UNSEEN, "tripped", "offline", "unknown", "running", "stopped"];
const MOVING = new Set(["forward", "reverse", "running", "stopping"]);
/** Fewer are seen at a glance. */
const DRIVES_MIN = 5;

let counts = null;
let box = null;
let input = null;
let part = null;
/** The drives that were in the chosen state when it was chosen: none comes or goes under a finger. */
let chosen = null;
let state = null;
let written = "";
let empty = null;

/** Puts the box into `element`, the counts into `list`, and into `none` what is said where no drive is left. */
export function start(element, list, none) {
  empty = none;
  add(empty, t("filter.empty"), " ", h("button", { type: "button", class: "link", click: clear }, t("filter.clear")));
  counts = list;
  box = element;
  input = h("input", { type: "search", placeholder: t("filter.name"), "aria-label": t("filter.with"), autocomplete: "off", input: apply });
  part = h("select", { "aria-label": t("filter.of"), change: apply });
  add(box, part, input);
}

/** Offers the lines and groups of these drives. */
export function parts(all) {
  const wanted = part.value;
  const sorts = [["line", t("lines")], ["group", t("groups")]].map(([key, label]) => [key, label, [...new Set(all.map((drive) => drive[key]).filter(Boolean))].sort()]);
  const options = sorts.filter(([key, , names]) => names.length > (key === "line" ? 1 : 0)).map(([key, label, names]) =>
    h("optgroup", { label }, ...names.map((name) => h("option", { value: `${key}:${name}` }, called(`${key}s`, name)))));
  fill(part, h("option", { value: "" }, t("filter.all")), ...options);
  part.value = wanted;
  if (part.value !== wanted) part.value = "";
  show(part, options.length > 0);
  apply();
}

/** Counts the drives by their state. */
export function count(all) {
  const many = new Map(COUNTED.map((word) => [word, 0]));
  for (const drive of all) many.set(counted_as(drive), (many.get(counted_as(drive)) ?? 0) + 1);
  const shown = [...many].filter(([word, it]) => it > 0 || word === state);
  const wanted = JSON.stringify([shown, state]);
  show(box, all.length >= DRIVES_MIN || written !== "");
  if (counts.dataset.shown === wanted) return;
  counts.dataset.shown = wanted;
  const focused = counts.contains(document.activeElement) ? document.activeElement.dataset.state : null;
  fill(counts, ...shown.map(([word, it]) => h("li", {}, button(word, it))));
  if (focused) counts.querySelector(`button[data-state="${focused}"]`)?.focus();
}

function button(word, many) {
  return h(
    "button",
    { type: "button", class: "count", "data-state": word, "aria-pressed": String(word === state), click: () => choose(word) },
    h("b", {}, number(many)),
    ` ${t(`count.${word}`, { count: many })}`,
  );
}

const counted_as = ({ run_state, may_still_run }) => (may_still_run ? UNSEEN : MOVING.has(run_state) ? "running" : run_state);

/** Shows the drives that are in this state now; all, if it was chosen already. */
function choose(word) {
  state = word === state ? null : word;
  const those = drives.all().filter((drive) => counted_as(drive) === state);
  chosen = state === null ? null : new Set(those.map(({ name }) => name));
  count(drives.all());
  apply();
}

function clear() {
  input.value = part.value = "";
  if (state !== null) choose(state);
  apply();
  input.focus();
}

function apply() {
  written = input.value.trim().toLowerCase();
  const [key, wanted] = part.value.split(/:(.*)/s);
  const texts = ({ name, line, group: of, vendor, title, model }) =>
    [name, called("drives", name), line, called("lines", line), of, called("groups", of), vendor, title, model].join(" ").toLowerCase();
  const is_chosen = (drive) => (chosen === null || chosen.has(drive.name)) && (key === "" || drive[key] === wanted);
  const is_wanted = (drive) => is_chosen(drive) && texts(drive).includes(written);
  drives.filter(is_wanted);
  const all = drives.all();
  show(empty, all.length > 0 && !all.some(is_wanted));
  attribute(box, "data-filtered", chosen === null && written === "" && key === "" ? null : "");
}
