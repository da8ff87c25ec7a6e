// The last hour of a drive: one chart for each unit, with a common cursor.

import { clock, h, number, show, text, unit as written } from "./dom.js";
import { choices, document_at, labelled, query } from "./fetched.js";

const EVERY_MS = 10_000;
const HEIGHT = 190;
const HEIGHT_LATER = 140;
const COLOURS = ["--series-1", "--series-2", "--series-3", "--series-4"];

/** The panel of the trend. */
export class Trend {
  constructor(element) {
    this.element = element;
    this.drive = h("select", { change: () => this.load() });
    this.place = h("div", { class: "charts" });
    this.message = h("p", { class: "message", role: "status" }, "");
    this.charts = [];
    this.shown = null;
    this.is_open = false;
    element.append(h("div", { class: "tools" }, labelled("Drive", this.drive)), this.message, this.place);
    setInterval(() => this.is_open && document.visibilityState === "visible" && this.load(), EVERY_MS);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw_anew());
    new ResizeObserver(() => this.resize()).observe(this.place);
  }

  names(drives) {
    choices(this.drive, drives);
  }

  open() {
    this.is_open = true;
    this.load();
  }

  close() {
    this.is_open = false;
  }

  async load() {
    const drive = this.drive.value;
    if (!drive) return;
    const { answer, error } = await document_at(query("api/v1/trend", { drive }), this.element);
    if (!this.is_open || drive !== this.drive.value) return;
    if (!answer) {
      this.tell(error);
      return;
    }
    const is_empty = !answer.values.some((column) => column.some((value) => value !== null));
    this.tell(is_empty ? "Nothing has been recorded of this drive yet." : "");
    const before = this.answer;
    this.answer = answer;
    const layout = JSON.stringify([answer.drive, answer.columns]);
    if (layout !== this.shown || !before) {
      this.shown = layout;
      this.draw_anew();
    } else {
      this.charts.forEach(({ chart, columns }) => renew(chart, data(answer, columns)));
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

  draw_anew() {
    this.charts.forEach(({ chart }) => chart.destroy());
    this.charts = [];
    this.place.replaceChildren();
    if (!this.answer || typeof uPlot === "undefined") return;
    const units = [...new Set(this.answer.columns.map((column) => column.unit))];
    for (const unit of units) {
      const columns = this.answer.columns.map((column, index) => ({ ...column, index })).filter((column) => column.unit === unit);
      const summary = h("p", { class: "unseen" });
      const element = h("div", { class: "chart", role: "group" });
      this.place.append(element, summary);
      const height = this.charts.length === 0 ? HEIGHT : HEIGHT_LATER;
      const chart = new uPlot(options(unit, columns, this.place.clientWidth || 600, height), data(this.answer, columns), element);
      this.charts.push({ chart, columns, summary, element });
    }
    this.describe();
  }

  /** Says in words what the curves show. */
  describe() {
    for (const { columns, summary, element } of this.charts) {
      const told = columns.map(({ label, name, unit, index }) => {
        const values = this.answer.values[index].filter((value) => value !== null);
        if (values.length === 0) return `${label ?? name}: no values`;
        const [least, most] = [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))];
        return `${label ?? name}: ${number(values.at(-1))} ${written(unit)} last, ${number(least)} to ${number(most)} ${written(unit)} in the last hour`;
      });
      text(summary, told.join(". "));
      element.setAttribute("aria-label", `Chart. ${told.join(". ")}`);
    }
  }
}

/** Shows new data; a part that was zoomed into stays. */
function renew(chart, next) {
  const { min, max } = chart.scales.x;
  const times = chart.data[0];
  const is_zoomed = times.length > 0 && (min > times[0] || max < times.at(-1));
  chart.setData(next, !is_zoomed);
  if (is_zoomed) chart.redraw();
}

function data({ end_at_s, step_s, values }, columns) {
  const count = Math.max(0, ...values.map((column) => column.length));
  const times = Array.from({ length: count }, (_, index) => end_at_s - (count - 1 - index) * step_s);
  return [times, ...columns.map(({ index }) => values[index])];
}

function options(unit, columns, width, height) {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(name).trim();
  const font = `12px ${style.getPropertyValue("--font").trim()}`;
  const axis = { stroke: colour("--muted"), font, grid: { stroke: colour("--grid"), width: 1 }, ticks: { show: false } };
  const decimals = unit === "Hz" ? 2 : 1;
  return {
    width,
    height,
    padding: [8, 12, 0, 0],
    // Where nothing can hover over a curve, its legend has no value to show.
    legend: { live: matchMedia("(hover: hover)").matches },
    cursor: { sync: { key: "trend" }, drag: { x: true, y: false } },
    scales: { x: { time: true }, y: { range: (_, least, most) => range(least, most) } },
    axes: [
      { ...axis, values: (_, splits) => splits.map((at) => clock(at * 1000).slice(0, 5)), space: 60, size: 28 },
      { ...axis, size: 52, values: (_, splits) => splits.map((value) => number(value)) },
    ],
    series: [
      { label: "Time", value: (_, at) => (at === null ? "–" : clock(at * 1000)) },
      ...columns.map(({ label, name, index }) => ({
        label: `${label ?? name} (${written(unit)})`,
        stroke: colour(COLOURS[index % COLOURS.length]),
        width: 2,
        dash: name.includes("setpoint") ? [6, 4] : undefined,
        points: { show: false },
        value: (_, value) => (value === null || value === undefined ? "–" : number(value, decimals)),
      })),
    ],
  };
}

/** From zero where zero is near, so that a small change does not look like a large one. */
function range(least, most) {
  if (least === null || most === null) return [0, 1];
  const margin = (most - least) * 0.1 || Math.abs(most) * 0.1 || 1;
  return [least >= 0 && least < most * 0.6 ? 0 : least - margin, most + margin];
}
