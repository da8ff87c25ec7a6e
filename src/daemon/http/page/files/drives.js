// A card for each drive.

import { Controls } from "./control.js";
import { announce, attribute, fill, h, keyed, reshape, shape, show, text } from "./dom.js";
import * as leases from "./leases.js";
import { number, recent, role, span, t, unit, value_label, words } from "./texts.js";
import { before } from "./trip_history.js";

// What an operator looks for comes first; the rest is one click away.
const FIRST_VALUES = 5;
/** What an operator looks for before all else. */
const LOOKED_FOR = ["output_current", "output_power", "torque", "output_voltage", "dc_link_voltage", "temperature"];

const AGES_MS = 500;
/** How soon after a trip the journal is asked. */
const SETTLE_MS = 1000;
/** Ages out of sight are drawn once in so many times. */
const OUT_OF_SIGHT = 10;

/** Orders by which a motor may run. */
const RUNS = new Set(["forward", "reverse"]);
/** Of a declared action: it did not show its effect. */
const OPEN_STAGES = new Set(["due", "sent", "given_up"]);

const cards = new Map();
/** The card of each element. */
const of_element = new WeakMap();
let ticks = 0;
let place = null;
let is_live = false;
let are_rows = false;
/** The names as they are configured, and as they are shown. */
let configured = [];
let order = [];

/** Prepares the cards inside `element`. */
export function start(element) {
  place = element;
  setInterval(draw_ages, AGES_MS);
  leases.changed((name) => cards.get(name)?.draw());
}

/** Cards out of sight are drawn less often: with many drives it is most of what the page costs. */
function draw_ages() {
  ticks += 1;
  for (const card of cards.values()) {
    if (card.is_seen || ticks % OUT_OF_SIGHT === 0) card.draw_ages();
  }
}

const watcher = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) of_element.get(target)?.see(isIntersecting);
}, { rootMargin: "25%" });

/** Shows these drives and no others. */
export function replace(drives) {
  configured = drives.map(({ name }) => name);
  arrange(drives);
  update(drives);
}

/** Puts them into the order that was chosen; a new drive is the last. */
function arrange(drives) {
  const rank = ({ name }) => (order.includes(name) ? order.indexOf(name) : order.length);
  const sorted = [...drives].sort((one, other) => rank(one) - rank(other));
  keyed(place, cards, sorted, (drive) => drive.name, (drive) => new Card(drive.name));
}

/** Shows what is new of some drives: of each the keys that changed, and of its values those that did. */
export function update(drives) {
  for (const drive of drives) cards.get(drive.name)?.take(drive);
}

/** How old the oldest value of each of these is. */
export function oldest(ages_ms) {
  for (const [name, age_ms] of Object.entries(ages_ms)) cards.get(name)?.take_age(age_ms);
}

/** Shows only the drives for which `is_wanted`; what is hidden stays up to date. */
export function filter(is_wanted) {
  for (const { element, drive } of cards.values()) show(element, !drive || is_wanted(drive));
}

/** Sorts them as they are now; `null`: as they are configured. What changes later moves none of them. */
export function sort(compare) {
  const now = configured.map((name) => cards.get(name).drive);
  order = compare === null ? configured : now.sort(compare).map(({ name }) => name);
  arrange(now);
}

/** Shows each as a row, of which one may be open, or as a card. */
export function as_rows(is) {
  are_rows = is;
  cards.forEach((card) => card.draw());
}

/** Draws all again, because what is around them has changed. */
export function redraw(is_live_now = is_live) {
  is_live = is_live_now;
  cards.forEach((card) => card.draw());
}

/** Whether every motor is known to stand. */
export function all_stand() {
  return cards.size > 0 && [...cards.values()].every((card) => card.stands());
}

/** All drives as they were last told. */
export function all() {
  return [...cards.values()].map((card) => card.drive).filter(Boolean);
}

class Card {
  constructor(name) {
    this.name = name;
    this.drive = null;
    this.aged = 0;
    this.rows = new Map();
    this.rest = new Map();
    this.shape = shape("unknown");
    this.state = h("span", { class: "word" });
    this.about = h("p", { class: "about" });
    this.output = h("span", { class: "number" });
    this.setpoint = h("span", { class: "number" });
    this.lost = h("p", { class: "headline" }, t("unseen.title"));
    this.last_seen = h("p");
    this.awaited = h("p");
    this.unseen = h("div", { class: "unseen-run", hidden: true }, this.lost, this.last_seen, this.awaited, h("p", { class: "go" }, t("unseen.go")));
    this.trip = h("p", { class: "trip" });
    this.at_trip = h("p", { class: "trip" });
    this.before = h("p", { class: "trip", hidden: true });
    this.looked_up = null;
    this.marks = h("ul", { class: "marks", "aria-label": t("drive.marks") });
    this.values = h("dl", { class: "values" });
    this.others = h("dl", { class: "values" });
    this.summary = h("summary");
    this.details = h("details", { class: "others" }, this.summary, this.others);
    this.owner = h("p", { class: "owner" });
    this.age = h("p", { class: "age" });
    this.controls = new Controls(name);
    const id = `drive-${name}`;
    this.open = h("a", { class: "open" }, name);
    const close = h("a", { class: "close", href: "#drives-title", "aria-label": t("drive.close", { name }) }, t("close"));
    this.element = h(
      "article",
      { class: "card drive", id, tabindex: "-1", "aria-labelledby": `${id}-name` },
      h("header", {}, h("h3", { id: `${id}-name` }, this.open), h("p", { class: "state" }, this.shape, this.state), close),
      // Above all that comes and goes: a hand that is on its way finds it where it was.
      this.controls.stops,
      this.about,
      this.unseen,
      h(
        "div",
        { class: "figures" },
        h("p", { class: "output" }, h("span", { class: "label" }, t("drive.output")), h("span", { class: "figure" }, this.output, h("span", { class: "unit" }, "Hz"))),
        h("p", { class: "set" }, h("span", { class: "label" }, t("drive.set")), h("span", { class: "figure" }, this.setpoint, h("span", { class: "unit" }, "Hz"))),
      ),
      h("div", { class: "notes", tabindex: "0", role: "group", "aria-label": t("drive.notes", { name }) }, this.trip, this.at_trip, this.before, this.marks),
      this.controls.element,
      this.values,
      this.details,
      h("footer", {}, this.owner, this.age),
    );
    this.is_seen = true;
    of_element.set(this.element, this);
    watcher.observe(this.element);
  }

  /** It has come into the window, or left it. */
  see(is) {
    this.is_seen = is;
    if (is) this.draw_ages();
  }

  take(news) {
    const before = this.drive;
    const now = performance.now();
    // A whole document names the model; it may have other values than before.
    const kept = news.model === undefined ? before?.values ?? [] : [];
    const known = new Map(kept.map((value) => [value.name, value]));
    for (const value of news.values ?? []) known.set(value.name, { ...known.get(value.name), ...value, taken: now });
    const drive = { ...before, ...news, values: [...known.values()] };
    if (news.control) drive.control = { ...news.control, taken: now };
    if (news.oldest_ms !== undefined) this.aged = now;
    this.drive = drive;
    leases.observe(drive);
    if (drive.may_still_run && !before?.may_still_run) announce(`${this.name}: ${t("unseen.title")}. ${t("unseen.go")}`, true);
    if (before && before.run_state !== drive.run_state && drive.run_state !== "tripped") {
      announce(`${this.name}: ${words(drive.run_state)}`);
    }
    this.draw();
  }

  take_age(age_ms) {
    if (!this.drive) return;
    this.drive.oldest_ms = age_ms;
    this.aged = performance.now();
  }

  draw() {
    const { drive } = this;
    if (!drive) return;
    const { run_state, line, station, vendor, title, model } = drive;
    attribute(this.element, "data-state", run_state);
    attribute(this.open, "href", are_rows ? `#${this.element.id}` : null);
    this.element.classList.toggle("whole", this.is_whole());
    reshape(this.shape, run_state);
    text(this.state, words(run_state));
    attribute(this.about, "title", model);
    text(this.about, t("drive.about", { model: title ? `${vendor} ${title}` : model, line, station: station ?? words("unknown") }));
    this.figure(this.output, drive.output_frequency_hz);
    this.figure(this.setpoint, drive.setpoint_hz);
    this.draw_unseen(drive);
    this.draw_trip(drive);
    this.draw_marks(drive);
    if (this.is_whole()) this.draw_values(drive);
    this.controls.update(drive, is_live);
    this.draw_ages();
  }

  /** Whether all of it is shown, and not only a row. */
  is_whole() {
    return !are_rows || location.hash === `#${this.element.id}`;
  }

  /** Whether its motor is known to stand now: what is old, ordered to run or not yet stopped may run. */
  stands() {
    const { presence, run_state, may_still_run, output_frequency_hz: output, oldest_ms, control, values = [] } = this.drive ?? {};
    const is_old = oldest_ms === null || values.some(({ role: of, quality }) => of === "output_frequency" && quality !== "good");
    const is_open = RUNS.has(control?.intent) || control?.command_pending || control?.stop_pending || control?.not_effective;
    const is_at_rest = (run_state === "stopped" && !(output > 0)) || (run_state === "tripped" && output === 0);
    return is_live && presence === "online" && is_at_rest && !may_still_run && !is_old && !is_open;
  }

  figure(element, value) {
    text(element, number(value, 2));
    element.classList.toggle("none", value === null || value === undefined);
  }

  /** A motor that may turn where the gateway does not see it is told in place of all that is not known any more. */
  draw_unseen({ may_still_run, last_seen, control }) {
    this.element.classList.toggle("unseen-drive", may_still_run === true);
    show(this.unseen, may_still_run === true);
    if (!may_still_run) return;
    const stage = control?.failsafe?.stage;
    const awaited = [control?.stop_pending && t("mark.stop_pending"), OPEN_STAGES.has(stage) && t(`mark.failsafe.${stage}`)];
    text(this.awaited, awaited.filter(Boolean).join(" · "));
    show(this.awaited, this.awaited.textContent !== "");
    if (!last_seen) return text(this.last_seen, t("unseen.never"));
    const { run_state, output_hz, at } = last_seen;
    const state = [words(run_state), typeof output_hz === "number" ? `${number(output_hz, 2)} Hz` : null].filter(Boolean).join(" ");
    text(this.last_seen, t("unseen.last", { state, at: recent(at) }));
  }

  draw_trip({ trip }) {
    this.draw_before(trip);
    if (!trip) return show(this.trip, false);
    const is_told = String(trip.text ?? "").includes(String(trip.code ?? ""));
    const name = [is_told ? null : trip.code, trip.text].filter((part) => part !== null && part !== undefined && part !== "").join(" ");
    const when = trip.last_at ? `, ${recent(trip.last_at)}` : "";
    const often = trip.count > 0 ? ` (${t("trip.in_all", { count: trip.count })})` : "";
    const is_active = trip.active === true;
    this.trip.classList.toggle("active", is_active);
    show(this.trip, is_active || trip.count > 0);
    text(this.trip, `${t(is_active ? "trip.active" : "trip.last")} ${in_words(name)}${when}${often}`);
    const at_trip = Object.entries(trip.values ?? {}).filter(([, { value, unit: of }]) => of && value !== null);
    show(this.at_trip, at_trip.length > 0 && !this.trip.hidden);
    text(this.at_trip, t("trip.values", { values: at_trip.map(([key, { value, unit: of }]) => `${role(key.replace(/^trip_/, ""))} ${number(value)} ${unit(of)}`).join(", ") }));
  }

  /** How often this trip came before, which is looked up once for each trip, where all of the drive is shown. */
  async draw_before(trip) {
    const is_active = trip?.active === true && trip.code !== null;
    // A trip is counted when the journal has it.
    const wanted = is_active ? `${trip.code} ${trip.seen} ${trip.total}` : null;
    if (wanted === this.looked_up || (is_active && !this.is_whole())) return;
    this.looked_up = wanted;
    show(this.before, false);
    if (!is_active) return;
    // The journal needs a moment to have it.
    await new Promise((done) => setTimeout(done, SETTLE_MS));
    const is_wanted = () => wanted === this.looked_up;
    const found = await before(this.name, trip.code, is_wanted);
    if (found === null || !is_wanted()) return;
    const { count, last_at } = found;
    text(this.before, count === 0 ? t("trip.first") : t("trip.before", { count, last: recent(last_at) }));
    show(this.before, true);
  }

  draw_marks({ presence, status, control, watchdog, trip, warning, standby, output_frequency_hz }) {
    this.element.classList.toggle("astray", Boolean(control?.output_outside || control?.stopped_elsewhere));
    const marks = [
      [control?.output_outside, "bad", t("mark.output_outside", { output: number(output_frequency_hz, 2), least: control?.min_hz, most: control?.max_hz })],
      [control?.stopped_elsewhere, "bad", t("mark.stopped_elsewhere")],
      [presence === "offline", "unknown", t("mark.offline")],
      [standby === "listening", "info", t("mark.standby")],
      [control?.not_effective, "bad", t("mark.not_effective")],
      [control?.failsafe, "bad", t(`mark.failsafe.${control?.failsafe?.stage}`)],
      [control?.stop_pending, "bad", t("mark.stop_pending")],
      [status?.local === true, "warn", t("mark.local")],
      [status?.alarm === true, "warn", t("mark.alarm")],
      [warning, "warn", t("mark.warning", { warning })],
      [status?.ready === false, "warn", t("mark.not_ready")],
      [control?.start_inhibited, "info", t("mark.start_inhibited")],
      [control?.command_pending, "info", t("mark.command_pending")],
      // Some drives only count their trips.
      [trip?.active === null && presence === "online", "info", t(trip.count === null ? "mark.trip_not_read" : "mark.trip_unknown")],
      [watchdog, "info", t("mark.watchdog", { state: words(watchdog) })],
      [!control, "info", t("mark.read_only")],
    ].filter(([is]) => is);
    const wanted = marks.map(([, kind, label]) => `${kind}:${label}`).join("|");
    if (this.marks.dataset.shown === wanted) return;
    this.marks.dataset.shown = wanted;
    fill(this.marks, ...marks.map(([, kind, label]) => h("li", { class: kind }, label)));
  }

  draw_values({ values = [], usage }) {
    const is_first = (value) => value.unit && value.unit !== "Hz" && value.unit !== "s";
    const rank = ({ role }) => (LOOKED_FOR.includes(role) ? LOOKED_FOR.indexOf(role) : LOOKED_FOR.length);
    const by_rank = values.filter(is_first).sort((one, other) => rank(one) - rank(other));
    const first = by_rank.slice(0, FIRST_VALUES);
    const others = [...values.filter((value) => !first.includes(value)), ...used(usage)];
    keyed(this.values, this.rows, first, (value) => value.name, (value) => new Row(value));
    keyed(this.others, this.rest, others, (value) => value.name, (value) => new Row(value));
    first.forEach((value) => this.rows.get(value.name).take(value));
    others.forEach((value) => this.rest.get(value.name).take(value));
    show(this.details, others.length > 0);
    text(this.summary, t("drive.more_values", { count: others.length }));
  }

  /** Ages go on between what the gateway tells. */
  draw_ages() {
    const { drive } = this;
    if (!drive) return;
    this.element.classList.toggle("stands", this.stands());
    if (!this.is_whole()) return;
    const now = performance.now();
    [...this.rows.values(), ...this.rest.values()].forEach((row) => row.draw_age(now));
    const oldest_ms = drive.oldest_ms ?? null;
    text(this.age, oldest_ms === null ? t("drive.no_fresh_value") : t("drive.oldest", { age: span(oldest_ms + now - this.aged) }));
    this.draw_owner(drive, now - (drive.control?.taken ?? now));
  }

  draw_owner({ control, may_still_run }, since) {
    show(this.owner, Boolean(control));
    if (!control) return;
    const every_ms = leases.every_ms(this.name);
    const left = control.lease_left_ms === null ? "" : `, ${t("owner.lease", { left: span(Math.max(0, control.lease_left_ms - since)) })}`;
    const is_run = control.intent === "forward" || control.intent === "reverse";
    const set = is_run && control.setpoint_hz !== null ? ` ${number(control.setpoint_hz, 2)} Hz` : "";
    // Without an order to run, a stop is one only while it waits for its effect. None of them reaches a drive out of sight.
    const order = (is_run || control.stop_pending) && !may_still_run ? ` · ${t("owner.order", { order: `${words(control.intent)}${set}` })}` : "";
    if (!control.owner) text(this.owner, `${t("owner.none")}${order}`);
    else if (every_ms === null) text(this.owner, `${t("owner.client", { owner: control.owner })}${left}${order}`);
    else if (leases.is_refused(this.name)) text(this.owner, `${t("owner.tab_refused")}${left}${order}`);
    else text(this.owner, `${t("owner.tab", { every: span(every_ms) })}${left}${order}`);
    attribute(this.owner, "title", this.owner.textContent);
    this.owner.classList.toggle("ours", every_ms !== null && Boolean(control.owner));
  }
}

/** How sure a text is, in words for people. */
function in_words(sentence) {
  return sentence.replace(/\((sibling|inferred|third-party)\)/g, (_, word) => `(${t(`confidence.${word}`)})`);
}

/** A value with its name, unit and quality. */
class Row {
  constructor(value) {
    const label = value_label(value);
    this.decimals = 0;
    this.value = null;
    this.number = h("span", { class: "number" });
    this.unit = h("span", { class: "unit" });
    this.note = h("span", { class: "note" });
    this.element = h("div", { class: "value" }, h("dt", { title: value.label ?? label }, label), h("dd", {}, this.number, this.unit, this.note));
  }

  take(value) {
    this.value = value;
    this.decimals = Math.min(3, Math.max(this.decimals, decimals(value.value)));
    const is_number = typeof value.value === "number";
    text(this.number, value.text ?? (is_number ? number(value.value, this.decimals) : "–"));
    text(this.unit, is_number && value.text === null ? unit(value.unit) : "");
    attribute(this.element, "data-quality", value.quality);
  }

  draw_age(now) {
    const { quality, age_ms, taken } = this.value;
    text(this.note, quality === "stale" ? t("value.stale", { age: span(age_ms + now - taken) }) : quality === "never" ? t("value.never") : "");
  }
}

/** What the drive has used, as values. */
function used(usage) {
  const units = { energy_kwh: "kWh", running_hours: "h", starts: null, trips: null };
  const known = Object.entries(units).filter(([key]) => typeof usage?.[key] === "number");
  return known.map(([key, unit]) => ({ name: `used.${key}`, label: t(`used.${key}`), unit, value: usage[key], text: null, quality: "good" }));
}

function decimals(value) {
  return typeof value === "number" ? (String(Math.round(value * 1000) / 1000).split(".")[1]?.length ?? 0) : 0;
}
