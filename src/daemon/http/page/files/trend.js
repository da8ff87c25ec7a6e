// Trends of drives: one chart for each unit, with a common cursor, and trips and commands as marks.

import { add, fill, h, keyed, show, text } from "./dom.js";
import { document_at, labelled, query } from "./fetched.js";
import { data, draw, renew } from "./chart.js";
import { number, t, unit as written, value_label } from "./texts.js";
import { called } from "./titles.js";

const EVERY_MS = { "1h": 10_000, "24h": 60_000, "7d": 60_000, "30d": 60_000 };
const SPANS = ["1h", "24h", "7d", "30d"].map((word) => [word, t(`span.${word}`)]);
const MARKS_MAX = 500;
/** More curves than that are not told apart. */
const DRIVES_MAX = 4;
/** One value of each of these is shown unless others are chosen. */
const USUAL_UNITS = ["Hz", "Hz", "A", "V"];

let library = null;

/** What draws the curves is fetched with the first of them. */
function fetch_library() {
  library ??= new Promise((done, failed) => {
    const script = h("script", { src: "assets/uplot.min.js", load: done, error: failed });
    add(document.head, h("link", { rel: "stylesheet", href: "assets/uplot.min.css" }), script);
  });
  return library.catch(() => (library = null));
}

/** The panel of the trend. */
export class Panel {
  constructor(element) {
    this.element = element;
    this.drives = new Choice(t("trend.drives"), () => this.load(), "drives");
    this.values = new Choice(t("trend.values"), () => this.load());
    this.span = h("select", { change: () => this.load() }, ...SPANS.map(([value, label]) => h("option", { value }, label)));
    this.exports = h("span", { class: "export" });
    const button = (label, act) => h("button", { type: "button", class: "plain", click: act }, label);
    this.zoomed = h("span", { class: "export", hidden: true },
      button(t("trend.earlier"), () => this.pan(-0.5)), " ", button(t("trend.later"), () => this.pan(0.5)), " ", button(t("trend.whole"), () => this.whole()));
    this.place = h("div", { class: "charts" });
    this.message = h("p", { class: "message", role: "status" }, "");
    this.charts = [];
    this.answers = [];
    this.marks = [];
    this.shown = null;
    this.is_open = false;
    this.loaded = 0;
    const zone = Intl.DateTimeFormat().resolvedOptions().timeZone;
    add(
      element,
      h("div", { class: "tools" }, this.drives.element, labelled(t("trend.span"), this.span), this.values.element, this.zoomed, this.exports),
      this.message,
      this.place,
      h("p", { class: "about" }, t("trend.how", { zone })),
    );
    setInterval(() => this.is_due() && this.load(), 1000);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
    new ResizeObserver(() => this.resize()).observe(this.place);
  }

  names(drives) {
    this.drives.offer(drives.map((name) => [name, called("drives", name)]), drives.slice(0, 1));
  }

  open() {
    this.is_open = true;
    this.load();
  }

  close() {
    this.is_open = false;
  }

  is_due() {
    return this.is_open && document.visibilityState === "visible" && performance.now() - this.loaded >= EVERY_MS[this.span.value];
  }

  async load() {
    const drives = this.drives.chosen().slice(0, DRIVES_MAX);
    const span = this.span.value;
    const values = this.values.is_changed ? this.values.chosen().join(",") : "";
    const wanted = JSON.stringify([drives, span, values]);
    this.wanted = wanted;
    this.loaded = performance.now();
    if (drives.length === 0) return this.tell(t("trend.choose"));
    if (this.answers.length === 0) this.tell(t("loading"));
    const path = (drive, more) => query("api/v1/trend", { drive, span, values, ...more });
    const all = await Promise.all(drives.map((drive) => document_at(path(drive, {}), this.element)));
    const marks = await this.load_marks(drives, span);
    await fetch_library();
    if (!this.is_open || wanted !== this.wanted) return;
    const wrong = all.find(({ answer }) => !answer);
    if (wrong) return this.tell(wrong.error);
    this.answers = all.map(({ answer }) => answer);
    this.marks = marks;
    const is_empty = !this.answers.some(({ values: columns }) => columns.some((column) => column.some((value) => value !== null)));
    this.tell(is_empty ? t("trend.empty") : "");
    fill(this.exports, "CSV: ", ...drives.flatMap((drive) => [h("a", { href: path(drive, { format: "csv" }), download: `${drive}.csv` }, called("drives", drive)), " "]));
    this.show(wanted);
  }

  /** Trips and commands in the time that is shown; none without a journal. */
  async load_marks(drives, since) {
    const rows = (drive) => fetch(query("api/v1/journal", { table: "all", drive, since, last: MARKS_MAX }), { cache: "no-store" })
      .then((response) => (response.ok ? response.json() : { rows: [] }))
      .catch(() => ({ rows: [] }));
    const found = await Promise.all(drives.map(rows));
    const is_mark = ({ table, kind }) => (table === "trips" && kind !== "cleared") || table === "audit";
    return found.flatMap(({ rows: all }) => all).filter(is_mark).map(({ at, table }) => ({ at_s: Date.parse(at) / 1000, is_trip: table === "trips" }));
  }

  show(wanted) {
    const offered = new Map(this.answers.flatMap(({ columns }) => columns.map((column) => [column.name, `${value_label(column)} (${written(column.unit)})`])));
    // What was not asked for is not offered either.
    if (!this.values.is_changed) this.values.offer([...offered], usual(this.answers[0].columns));
    const layout = JSON.stringify([wanted, this.answers.map(({ columns }) => columns), this.values.chosen()]);
    if (layout !== this.shown || this.charts.length === 0) {
      this.shown = layout;
      this.redraw();
    } else {
      this.charts.forEach(({ chart, series }) => renew(chart, data(this.answers, series)));
    }
    this.describe();
  }

  tell(message) {
    text(this.message, message);
    show(this.message, message !== "");
  }

  resize() {
    const width = this.place.clientWidth;
    if (width > 0) this.charts.forEach(({ chart }) => chart.width !== width && chart.setSize({ width, height: chart.height }));
  }

  /** All curves that are wanted, by their unit. */
  units() {
    const wanted = new Set(this.values.chosen());
    const units = new Map();
    let colour = 0;
    for (const [answer, { drive, columns }] of this.answers.entries()) {
      for (const [index, column] of columns.entries()) {
        const { name, unit } = column;
        if (!wanted.has(name)) continue;
        const label = value_label(column);
        const whole = this.answers.length > 1 ? `${called("drives", drive)}: ${label}` : label;
        units.set(unit, [...(units.get(unit) ?? []), { answer, index, name, label: whole, unit, colour: colour++ }]);
      }
    }
    return units;
  }

  redraw() {
    this.charts.forEach(({ chart }) => chart.destroy());
    this.charts = [];
    fill(this.place);
    show(this.zoomed, false);
    if (this.answers.length === 0 || typeof uPlot === "undefined") return;
    for (const [unit, series] of this.units()) {
      const summary = h("p", { class: "unseen" });
      const element = h("div", { class: "chart", role: "group" });
      add(this.place, element, summary);
      const shape = { unit, series, width: this.place.clientWidth || 600, is_first: this.charts.length === 0 };
      const chart = draw(shape, this.answers, element, () => this.marks, (is) => show(this.zoomed, is));
      this.charts.push({ chart, series, summary, element });
    }
    this.describe();
  }

  pan(share) {
    for (const { chart } of this.charts) {
      const { min, max } = chart.scales.x;
      const by = (max - min) * share;
      chart.setScale("x", { min: min + by, max: max + by });
    }
  }

  whole() {
    this.charts.forEach(({ chart }) => chart.setData(chart.data));
    show(this.zoomed, false);
  }

  /** Says in words what the curves show. */
  describe() {
    const span = SPANS.find(([value]) => value === this.span.value)[1];
    for (const { series, summary, element } of this.charts) {
      const told = series.map(({ answer, index, label, unit }) => {
        const values = this.answers[answer].values[index].filter((value) => value !== null);
        if (values.length === 0) return t("trend.no_values", { label });
        const [least, most] = [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))];
        return t("trend.summary", { label, last: values.at(-1), least, most, unit: written(unit), span });
      });
      text(summary, told.join(". "));
      element.setAttribute("aria-label", `${t("trend.chart")}. ${told.join(". ")}`);
    }
  }
}

/** The names of those columns that are shown unless others are chosen. */
function usual(columns) {
  if (columns.length <= USUAL_UNITS.length) return columns.map(({ name }) => name);
  const left = [...USUAL_UNITS];
  const is = ({ unit }) => left.includes(unit) && left.splice(left.indexOf(unit), 1).length > 0;
  const found = columns.filter(is).map(({ name }) => name);
  return found.length > 0 ? found : columns.slice(0, 1).map(({ name }) => name);
}

/** Some of many, behind one word. */
class Choice {
  constructor(label, changed, kind = null) {
    this.label = label;
    this.kind = kind;
    this.changed = changed;
    this.boxes = new Map();
    /** A person has chosen. */
    this.is_changed = false;
    this.summary = h("summary", {}, label);
    this.list = h("div", { class: "boxes" });
    this.element = h("details", { class: "several" }, this.summary, this.list);
    document.addEventListener("click", ({ target }) => this.element.contains(target) || (this.element.open = false));
  }

  /** Offers these, as name and label. What was chosen stays; without a choice it is `usual`. */
  offer(options, usual) {
    const make = ([name, label]) => {
      const box = h("input", { type: "checkbox", change: () => this.take() });
      box.checked = !this.is_changed && usual.includes(name);
      return { box, element: h("label", {}, box, " ", label) };
    };
    keyed(this.list, this.boxes, options, ([name]) => name, make);
    if (!this.is_changed) this.boxes.forEach(({ box }, name) => (box.checked = usual.includes(name)));
    this.tell();
  }

  chosen() {
    return [...this.boxes].filter(([, { box }]) => box.checked).map(([name]) => name);
  }

  take() {
    this.is_changed = true;
    this.tell();
    this.changed();
  }

  tell() {
    const chosen = this.chosen();
    const [name] = chosen;
    const one = chosen.length === 1 ? called(this.kind, name) : "";
    text(this.summary, `${this.label}: ${one === "" || one.length >= 20 ? number(chosen.length) : one === name ? one.replaceAll("_", " ") : one}`);
  }
}
