// One chart: curves of one unit over time, with marks.

import { clock, locale, number, t, unit as written } from "./texts.js";


const HEIGHT = 190;
const HEIGHT_LATER = 140;
const COLOURS = ["--series-1", "--series-2", "--series-3", "--series-4"];
const DAY_S = 86_400;

/** The columns of a chart: the times of all drives together, and each curve on them. */
export function data(answers, series) {
  const times = new Set(answers.flatMap((answer) => times_of(answer)));
  const sorted = [...times].sort((one, other) => one - other);
  const places = new Map(sorted.map((at, place) => [at, place]));
  const column = ({ answer, index }, kind) => {
    const values = new Array(sorted.length).fill(null);
    times_of(answers[answer]).forEach((at, row) => (values[places.get(at)] = answers[answer][kind][index][row]));
    return values;
  };
  const bands = has_bands(answers) ? series.flatMap((one) => [column(one, "min"), column(one, "max")]) : [];
  return [sorted, ...series.map((one) => column(one, "values")), ...bands];
}

/** Of one drive, what was within each row is shown as well. */
function has_bands(answers) {
  return answers.length === 1 && answers[0].min !== undefined;
}

function times_of({ end_at_s, step_s, values }) {
  const count = Math.max(0, ...values.map((column) => column.length));
  return Array.from({ length: count }, (_, index) => end_at_s - (count - 1 - index) * step_s);
}

/** Draws a chart into `element`. `zoomed` is told whether only a part is shown. */
export function draw(shape, answers, element, marks, zoomed) {
  const options = { ...look(shape, answers), hooks: { draw: [(chart) => draw_marks(chart, marks())], setScale: [(chart, key) => key === "x" && zoomed(is_zoomed(chart))] } };
  return new uPlot(options, data(answers, shape.series), element);
}

/** Shows new data; a part that was zoomed into stays. */
export function renew(chart, next) {
  const is = is_zoomed(chart);
  chart.setData(next, !is);
  if (is) chart.redraw();
}

function is_zoomed(chart) {
  const { min, max } = chart.scales.x;
  const times = chart.data[0];
  return times.length > 0 && (min > times[0] || max < times.at(-1));
}

function style() {
  const computed = getComputedStyle(document.documentElement);
  return (name) => computed.getPropertyValue(name).trim();
}

function look({ unit, series, width, is_first }, answers) {
  const of = style();
  const axis = { stroke: of("--muted"), font: `12px ${of("--font")}`, grid: { stroke: of("--grid"), width: 1 }, ticks: { show: false } };
  const decimals = unit === "Hz" ? 2 : 1;
  const colour = (one) => of(COLOURS[one.colour % COLOURS.length]);
  const curve = (one) => ({
    label: `${one.label} (${written(unit)})`,
    stroke: colour(one),
    width: 2,
    dash: one.name.includes("setpoint") ? [6, 4] : undefined,
    points: { show: false },
    value: (_, value) => (value === null || value === undefined ? "–" : number(value, decimals)),
  });
  const bands = has_bands(answers) ? series : [];
  const edge = (one) => ({ label: one.label, class: "edge", stroke: colour(one), width: 0.5, alpha: 0.5, points: { show: false } });
  return {
    width,
    height: is_first ? HEIGHT : HEIGHT_LATER,
    padding: [8, 12, 0, 0],
    // Where nothing can hover over a curve, its legend has no value to show.
    legend: { live: matchMedia("(hover: hover)").matches },
    cursor: { sync: { key: "trend" }, drag: { x: true, y: false } },
    scales: { x: { time: true }, y: { range: (_, least, most) => range(least, most) } },
    axes: [
      { ...axis, values: (_, splits, __, ___, step_s) => stamps(splits, step_s), space: 70, size: 28 },
      { ...axis, size: 52, values: (_, splits) => splits.map((value) => number(value)) },
    ],
    bands: bands.map((one, place) => ({ series: [1 + series.length + place * 2 + 1, 1 + series.length + place * 2], fill: `${colour(one)}33` })),
    series: [
      { label: t("heading.time"), value: (_, at) => (at === null ? "–" : `${day(at)} ${clock(at * 1000)}`) },
      ...series.map(curve),
      ...bands.flatMap((one) => [edge(one), edge(one)]),
    ],
  };
}

function day(at_s) {
  return new Date(at_s * 1000).toLocaleDateString(locale, { month: "short", day: "numeric" });
}

/** As exact as the steps are, so that no two are alike; the day where it changes. */
function stamps(splits, step_s) {
  return splits.map((at, place) => {
    const is_new_day = place > 0 && day(at) !== day(splits[place - 1]);
    if (step_s >= DAY_S || is_new_day) return day(at);
    return clock(at * 1000).slice(0, step_s < 60 ? 8 : 5);
  });
}

function draw_marks(chart, marks) {
  const { ctx, bbox } = chart;
  const of = style();
  const { min, max } = chart.scales.x;
  ctx.save();
  for (const { at_s, is_trip } of marks.filter((mark) => mark.at_s >= min && mark.at_s <= max)) {
    const x = Math.round(chart.valToPos(at_s, "x", true));
    ctx.beginPath();
    ctx.strokeStyle = of(is_trip ? "--bad" : "--muted");
    ctx.lineWidth = is_trip ? 2 : 1;
    ctx.setLineDash(is_trip ? [] : [1, 3]);
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
  }
  ctx.restore();
}

/** From zero where zero is near, so that a small change does not look like a large one. */
function range(least, most) {
  if (least === null || most === null) return [0, 1];
  const margin = (most - least) * 0.1 || Math.abs(most) * 0.1 || 1;
  return [least >= 0 && least <= most * 0.6 ? 0 : least - margin, most + margin];
}
