// A card for each drive.

import { Controls } from "./control.js";
import { announce, attribute, fill, h, keyed, reshape, shape, show, text } from "./dom.js";
import { fit } from "./fit.js";
import { Gauge } from "./gauge.js";
import * as leases from "./leases.js";
import { number, recent, role, span, t, unit, value_label, words } from "./texts.js";
import { called } from "./titles.js";
import { before } from "./trip_history.js";

// What an operator looks for comes first; the rest is one click away.
const FIRST_VALUES = 3;
/** What an operator looks for before all else. */
const LOOKED_FOR = ["output_current", "output_power", "torque", "output_voltage", "dc_link_voltage", "temperature"];

const AGES_MS = 500;
/** How soon after a trip the journal is asked. */
const SETTLE_MS = 1000;
/** Ages out of sight are drawn once in so many times. */
const OUT_OF_SIGHT = 10;
/** Curves move by a pixel in about this time. */
const CURVES_MS = 10_000;
/** How urgent marks of each kind are, and the rest that may be said: a small number comes first. */
const RANKS = { open: 1, unknown: 2, bad: 3, warn: 3, info: 6 };
const KINDS = { open: "bad", bad: "bad", unknown: "unknown", warn: "warn", info: "info" };
const TRIP_RANK = 2;
const DONE_RANK = 2.5;
/** How long a motor must show rest: registers that read as 0 for a second or two were seen in the field. */
const STANDS_AFTER_MS = 3000;
const OWNER_RANK = 4;
/** Texts of so many letters have room in the narrowest card. */
const SURE = { name: 32, said: 52 };

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
  setInterval(() => each_seen((card) => card.gauge.draw()), CURVES_MS);
  addEventListener("resize", () => requestAnimationFrame(() => cards.forEach((card) => card.fit())));
  leases.changed((name) => cards.get(name)?.draw());
}

/** Cards out of sight are drawn less often: with many drives it is most of what the page costs. */
function draw_ages() {
  ticks += 1;
  const now = performance.now();
  for (const card of cards.values()) {
    card.gauge.note(now, is_live ? card.drive?.output_frequency_hz ?? null : null);
    if (card.is_seen || ticks % OUT_OF_SIGHT === 0) card.draw_ages();
  }
}

function each_seen(act) {
  for (const card of cards.values()) if (card.is_seen && card.is_whole()) act(card);
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
  place.classList.toggle("single", drives.length === 1);
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
  if (is_live && !is_live_now) cards.forEach((card) => card.gauge.forget());
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
    /** What people call it; not written anywhere yet. */
    this.shown = null;
    this.drive = null;
    /** Since when the motor shows rest. */
    this.rests_since = null;
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
    this.facts = h("dl", { class: "facts" });
    this.values = h("dl", { class: "values" });
    this.owner = h("p", { class: "owner" });
    this.age = h("p", { class: "age" });
    this.gauge = new Gauge(name);
    this.controls = new Controls(name, () => this.drive && this.draw_said());
    this.said = h("p", { class: "words", tabindex: "0" });
    this.marked = [];
    /** What a person has opened. */
    this.opened = { operate: false, details: false };
    this.operate = this.opener("operate", t("drive.operate"), `operate-${name}`);
    this.more = this.opener("details", t("panels"), `details-${name}`);
    this.controls.element.id = `operate-${name}`;
    const id = `drive-${name}`;
    this.open = h("a", { class: "open" });
    this.heading = h("h3", { id: `${id}-name` }, this.open);
    this.notes = h("div", { class: "notes", tabindex: "0", role: "group" }, this.owner, this.trip, this.at_trip, this.before, this.marks);
    this.details = h("div", { class: "details", id: `details-${name}` }, this.notes, this.values);
    this.close = h("a", { class: "close", href: "#drives-title" }, t("close"));
    this.element = h(
      "article",
      { class: "card drive", id, tabindex: "-1", "aria-labelledby": `${id}-name` },
      h("header", {}, this.heading, this.close),
      // Above all that comes and goes: a hand that is on its way finds it where it was.
      h("div", { class: "head" }, h("p", { class: "state" }, this.shape, this.state), this.controls.stops),
      h(
        "div",
        { class: "live" },
        h(
          "div",
          { class: "figures" },
          h("p", { class: "output" }, h("span", { class: "label" }, t("drive.output")), h("span", { class: "figure" }, this.output, h("span", { class: "unit" }, "Hz"))),
          h("p", { class: "set" }, h("span", { class: "label" }, t("drive.setpoint")), h("span", { class: "figure" }, this.setpoint, h("span", { class: "unit" }, "Hz"))),
        ),
        this.gauge.bar,
        this.gauge.curve,
        this.facts,
        this.unseen,
      ),
      h("div", { class: "said" }, this.said, this.controls.result),
      h("div", { class: "more" }, this.operate, this.more, this.age),
      this.controls.element,
      this.details,
      this.about,
    );
    this.is_seen = false;
    of_element.set(this.element, this);
    watcher.observe(this.element);
  }

  /** A button that opens and closes a part of the card. */
  opener(part, label, controls) {
    const toggle = () => {
      this.opened[part] = !this.opened[part];
      this.draw();
    };
    return h("button", { type: "button", class: "plain opener", "aria-controls": controls, click: toggle }, label);
  }

  /** It has come into the window, or left it. */
  see(is) {
    this.is_seen = is;
    if (!is) return;
    this.draw_ages();
    this.fit();
    this.begin_curve();
  }

  begin_curve() {
    if (this.is_seen && is_live && this.drive && this.is_whole()) this.gauge.load();
  }

  fit() {
    fit(this.heading, SURE.name);
    fit(this.unseen, 0);
    fit(this.said, SURE.said);
    fit(this.controls.result, SURE.said);
  }

  take(news) {
    const before = this.drive;
    const now = performance.now();
    // A whole document names the model; it may have other values than before.
    const kept = news.model === undefined ? before?.values ?? [] : [];
    const known = new Map(kept.map((value) => [value.name, value]));
    for (const value of news.values ?? []) known.set(value.name, { ...known.get(value.name), ...value, taken: now });
    const drive = { ...before, ...news, values: [...known.values()] };
    this.draw_name();
    if (news.control) drive.control = { ...news.control, taken: now };
    if (news.oldest_ms !== undefined) this.aged = now;
    this.drive = drive;
    leases.observe(drive);
    if (drive.may_still_run && !before?.may_still_run) announce(`${this.shown}: ${t("unseen.title")}. ${t("unseen.go")}`, true);
    if (before && before.run_state !== drive.run_state && drive.run_state !== "tripped") {
      announce(`${this.shown}: ${words(drive.run_state)}`);
    }
    this.draw();
  }

  /** The title may change with the configuration. */
  draw_name() {
    const { name } = this;
    const shown = called("drives", name);
    if (shown === this.shown) return;
    this.shown = shown;
    text(this.open, shown);
    attribute(this.open, "title", shown === name ? null : name);
    attribute(this.close, "aria-label", t("drive.close", { name: shown }));
    attribute(this.notes, "aria-label", t("drive.notes", { name: shown }));
    this.controls.rename(shown);
    if (this.is_seen) fit(this.heading, SURE.name);
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
    const about = t("drive.about", { model: title ? `${vendor} ${title}` : model, line: called("lines", line), station: station ?? words("unknown") });
    text(this.about, this.shown === this.name ? about : `${this.name} · ${about}`);
    this.figure(this.output, drive.output_frequency_hz);
    this.figure(this.setpoint, drive.setpoint_hz);
    this.draw_unseen(drive);
    this.draw_trip(drive);
    this.draw_marks(drive);
    this.gauge.take(drive);
    this.controls.update(drive, is_live);
    this.draw_opened();
    if (this.is_whole()) this.draw_values(drive);
    this.draw_ages();
    this.begin_curve();
  }

  /** What is opened of it. Where there is room for all, all of it is. */
  draw_opened() {
    const is_all = cards.size === 1 || (are_rows && this.is_whole());
    const may_operate = this.controls.is_offered_at_all;
    this.has_details = is_all || this.opened.details;
    show(this.operate, may_operate && !is_all);
    show(this.more, !is_all);
    attribute(this.operate, "aria-expanded", this.opened.operate);
    attribute(this.more, "aria-expanded", this.opened.details);
    show(this.controls.element, may_operate && (is_all || this.opened.operate));
    show(this.details, this.has_details);
    this.element.classList.toggle("detailed", this.has_details);
    const is_whole = this.is_whole();
    if (this.was_whole !== is_whole) requestAnimationFrame(() => this.fit());
    this.was_whole = is_whole;
  }

  /** Whether all of it is shown, and not only a row. */
  is_whole() {
    return !are_rows || location.hash === `#${this.element.id}`;
  }

  /** Whether its motor is known to stand: it has shown rest for so long. */
  stands() {
    const now = performance.now();
    this.rests_since = this.shows_rest() ? this.rests_since ?? now : null;
    return this.rests_since !== null && now - this.rests_since >= STANDS_AFTER_MS;
  }

  /** Whether its motor shows rest now: what is old, out of sight, ordered to run or not yet stopped may run. */
  shows_rest() {
    const { presence, run_state, may_still_run, output_frequency_hz: output, oldest_ms, control, standby, values = [] } = this.drive ?? {};
    const is_fresh = oldest_ms !== null && values.some(({ role: of, quality }) => of === "output_frequency" && quality === "good");
    const is_open = RUNS.has(control?.intent) || control?.command_pending || control?.stop_pending || control?.not_effective;
    const is_at_rest = (run_state === "stopped" || run_state === "tripped") && output === 0;
    const is_seen = is_live && presence === "online" && standby !== "listening" && !may_still_run && is_fresh;
    return is_seen && is_at_rest && !is_open && this.controls.told_kind() !== "pending";
  }

  figure(element, value) {
    text(element, number(value, 2));
    element.classList.toggle("none", value === null || value === undefined);
  }

  /** A motor that may turn where the gateway does not see it is told in place of all that is not known any more. */
  draw_unseen({ may_still_run, last_seen, control }) {
    this.element.classList.toggle("unseen-drive", may_still_run === true);
    if (may_still_run && this.unseen.hidden) requestAnimationFrame(() => this.fit());
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
    const named = [t(is_active ? "trip.active" : "trip.last"), in_words(name)].filter(Boolean).join(" ");
    text(this.trip, `${named}${when}${often}`);
    // One without a name is told with its time.
    this.trip_name = name === "" ? this.trip.textContent : named;
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
    const stage = control?.failsafe?.stage;
    const marks = [
      [control?.output_outside, "open", t("mark.output_outside", { output: number(output_frequency_hz, 2), least: control?.min_hz, most: control?.max_hz })],
      [control?.stopped_elsewhere, "open", t("mark.stopped_elsewhere")],
      [presence === "offline", "unknown", t("mark.offline")],
      [standby === "listening", "info", t("mark.standby")],
      [control?.not_effective, "open", t("mark.not_effective")],
      [control?.failsafe, OPEN_STAGES.has(stage) ? "open" : "bad", t(`mark.failsafe.${stage}`)],
      [control?.stop_pending, "open", t("mark.stop_pending")],
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
    this.marked = marks.map(([, kind, label]) => [RANKS[kind], label, KINDS[kind]]);
    if (this.marks.dataset.shown === wanted) return;
    this.marks.dataset.shown = wanted;
    fill(this.marks, ...marks.map(([, kind, label]) => h("li", { class: KINDS[kind] }, label)));
  }

  /** The most important of all there is to say, whole, and how many others there are. */
  draw_said() {
    const { trip } = this.drive;
    const told = this.controls.told_kind();
    const told_rank = told === null ? Infinity : told === "good" ? DONE_RANK : 0;
    const all = [...this.marked, [OWNER_RANK + (this.drive.control?.owner ? 0 : 3), this.owner.textContent || t("mark.read_only"), "info"]];
    if (trip?.active === true) all.push([TRIP_RANK, this.trip_name, "bad"]);
    all.sort(([one], [other]) => one - other);
    const [rank, label, kind] = all[0];
    const is_result = told_rank <= rank;
    const others = all.filter(([of]) => of < OWNER_RANK).length - (is_result || rank >= OWNER_RANK ? 0 : 1);
    show(this.controls.result, is_result);
    show(this.said, !is_result);
    const sentence = others > 0 ? t("drive.said", { label, count: others }) : label;
    const is_other = this.said.textContent !== sentence;
    attribute(this.said, "class", `words ${kind}`);
    text(this.said, sentence);
    if (is_other && this.is_seen && !is_result) fit(this.said, SURE.said);
    if (is_result && this.is_seen && this.fitted !== this.controls.result.textContent) {
      this.fitted = this.controls.result.textContent;
      fit(this.controls.result, SURE.said);
    }
  }

  draw_values({ values = [], usage }) {
    const is_first = (value) => value.unit && value.unit !== "Hz" && value.unit !== "s";
    const rank = ({ role }) => (LOOKED_FOR.includes(role) ? LOOKED_FOR.indexOf(role) : LOOKED_FOR.length);
    const by_rank = values.filter(is_first).sort((one, other) => rank(one) - rank(other));
    const first = by_rank.slice(0, FIRST_VALUES).filter(({ role: of }) => LOOKED_FOR.includes(of));
    const all = this.has_details ? [...by_rank, ...values.filter((value) => !by_rank.includes(value)), ...used(usage)] : [];
    const name = (value) => value.name;
    keyed(this.facts, this.rows, first, name, (value) => new Row(value, t(`short.${value.role}`)));
    keyed(this.values, this.rest, all, name, (value) => new Row(value, value_label(value)));
    first.forEach((value) => this.rows.get(value.name).take(value));
    all.forEach((value) => this.rest.get(value.name).take(value));
  }

  /** Ages go on between what the gateway tells. */
  draw_ages() {
    const { drive } = this;
    if (!drive) return;
    this.element.classList.toggle("stands", this.stands());
    const now = performance.now();
    if (!this.is_whole()) {
      this.draw_owner(drive, now - (drive.control?.taken ?? now));
      return this.draw_said();
    }
    [...this.rows.values(), ...this.rest.values()].forEach((row) => row.draw_age(now));
    const oldest_ms = drive.oldest_ms ?? null;
    text(this.age, oldest_ms === null ? t("drive.no_fresh_value") : t("drive.oldest", { age: span(oldest_ms + now - this.aged) }));
    this.draw_owner(drive, now - (drive.control?.taken ?? now));
    this.draw_said();
  }

  draw_owner({ control, may_still_run }, since) {
    show(this.owner, Boolean(control));
    if (!control) return;
    const every_ms = leases.every_ms(this.name);
    const left = control.lease_left_ms === null ? "" : `, ${t("owner.lease", { left: span(Math.max(0, control.lease_left_ms - since)) })}`;
    const is_run = RUNS.has(control.intent);
    const set = is_run && control.setpoint_hz !== null ? ` ${number(control.setpoint_hz, 2)} Hz` : "";
    // Without an order to run, a stop is one only while it waits for its effect. None of them reaches a drive out of sight.
    const order = (is_run || control.stop_pending) && !may_still_run ? ` · ${t("owner.order", { order: `${words(control.intent)}${set}` })}` : "";
    if (!control.owner) text(this.owner, `${t("owner.none")}${order}`);
    else if (every_ms === null) text(this.owner, `${t("owner.client", { owner: control.owner })}${left}${order}`);
    else if (leases.is_refused(this.name)) text(this.owner, `${t("owner.tab_refused")}${left}${order}`);
    else text(this.owner, `${t("owner.tab", { every: span(every_ms) })}${left}${order}`);
    this.owner.classList.toggle("ours", every_ms !== null && Boolean(control.owner));
  }
}

/** How sure a text is, in words for people. */
function in_words(sentence) {
  return sentence.replace(/\((sibling|inferred|third-party)\)/g, (_, word) => `(${t(`confidence.${word}`)})`);
}

/** A value with its name, unit and quality. */
class Row {
  constructor(value, label) {
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
