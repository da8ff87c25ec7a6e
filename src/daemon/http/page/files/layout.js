// Cards or rows, and in which order.

import { add, h, show, text } from "./dom.js";
import * as drives from "./drives.js";
import { keep, kept } from "./kept.js";
import { t } from "./texts.js";
import { called } from "./titles.js";

/** Fewer drives need no choice. */
const CHOICE_MIN = 5;
/** More drives are shown as rows unless a person wants cards. */
const CARDS_MAX = 12;
const KEPT = "vfd-gateway-layout";
const PHONE = matchMedia("(max-width: 40rem)");
const ORDERS = [
  ["", t("order.configured")],
  ["state", t("order.state")],
  ["name", t("order.name")],
  ["line", t("order.line")],
  ["output", t("order.output")],
];
const WORST = ["tripped", "offline", "unknown", "stopping", "forward", "reverse", "running", "stopped"];
const BY = {
  state: (one, other) => WORST.indexOf(one.run_state) - WORST.indexOf(other.run_state),
  name: (one, other) => called("drives", one.name).localeCompare(called("drives", other.name), undefined, { numeric: true }),
  line: (one, other) => one.line.localeCompare(other.line, undefined, { numeric: true }) || (one.station ?? 0) - (other.station ?? 0),
  output: (one, other) => (other.output_frequency_hz ?? -1) - (one.output_frequency_hz ?? -1),
};

let place = null;
let tools = null;
let order = null;
let rows = null;
let many = 0;

/** Puts the choices into `element`, for the drives inside `list`. */
export function start(element, list) {
  tools = element;
  place = list;
  order = h("select", { change: sort }, ...ORDERS.map(([word, label]) => h("option", { value: word }, label)));
  rows = h("button", { type: "button", class: "plain", click: choose });
  add(tools, h("label", { class: "choice" }, h("span", {}, t("layout.order")), order), rows);
  PHONE.addEventListener("change", apply);
  addEventListener("hashchange", () => drives.redraw());
  document.addEventListener("keydown", ({ key }) => key === "Escape" && leave());
}

/** There are this many drives now. */
export function count(all) {
  if (many === all) return;
  many = all;
  show(tools, many >= CHOICE_MIN);
  apply();
}

/** Sorts the drives as they are now: none moves by itself under a finger. */
function sort() {
  drives.sort(BY[order.value] ?? null);
}

function choose() {
  keep(KEPT, is_rows() ? "cards" : "rows");
  apply();
}

function is_rows() {
  if (PHONE.matches) return many > 1;
  const chosen = kept(KEPT);
  return many >= CHOICE_MIN && (chosen === null ? many > CARDS_MAX : chosen === "rows");
}

function apply() {
  const is = is_rows();
  place.classList.toggle("rows", is);
  text(rows, t(is ? "layout.cards" : "layout.rows"));
  show(rows, !PHONE.matches);
  drives.as_rows(is);
}

/** Closes the drive that is open. It sends nothing. */
function leave() {
  const open = document.querySelector(".rows .whole");
  if (!open) return;
  location.hash = "drives-title";
  open.querySelector("a.open").focus();
}
