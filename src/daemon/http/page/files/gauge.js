// How fast a drive is: between its limits, and in the last ten minutes.

import { attribute, h, show, svg, text } from "./dom.js";
import { number, t } from "./texts.js";

/** As the gateway notes it: a value every 2 s. */
const STEP_MS = 2000;
const ROWS = 300;
const [WIDTH, HEIGHT] = [ROWS - 1, 30];
/** The top of a drive without limits. */
const USUAL_HZ = 50;
const TIMEOUT_MS = 15_000;

let last = Promise.resolve();

/** What was noted of a drive; nothing if that cannot be had. One drive after the other: a stop needs a connection too. */
function noted(drive) {
  const asked = new URLSearchParams({ drive, span: "10m" });
  const ask = async () => {
    const response = await fetch(`api/v1/trend?${asked}`, { cache: "no-store", signal: AbortSignal.timeout(TIMEOUT_MS) });
    const { columns, values } = await response.json();
    return values[columns.findIndex(({ unit, name }) => unit === "Hz" && name !== "setpoint")] ?? [];
  };
  last = last.then(ask).catch(() => []);
  return last;
}

/** The bar and the curve of one drive. */
export class Gauge {
  constructor(drive) {
    this.drive = drive;
    this.fill = svg("rect", { class: "fill", y: 4, height: 8, width: 0 });
    this.ordered = svg("svg", { class: "ordered" }, svg("path", { d: "M-5 0 H5 L0 6 Z M-1 6 H1 V14 H-1 Z" }));
    this.least = h("span", {});
    this.most = h("span", {});
    const track = svg("rect", { class: "track", y: 4, height: 8, width: "100%" });
    this.bar = h("div", { class: "bar", "aria-hidden": "true", hidden: true }, this.least, svg("svg", {}, track, this.fill, this.ordered), this.most);
    this.path = svg("path", {});
    const curve = svg("svg", { viewBox: `0 -1 ${WIDTH} ${HEIGHT + 2}`, preserveAspectRatio: "none" }, this.path);
    this.curve = h("div", { class: "spark", role: "img", "aria-label": t("drive.spark") }, curve, h("span", { "aria-hidden": "true" }, t("minutes", { minutes: 10 })));
    this.rows = null;
    this.noted = 0;
    this.top = USUAL_HZ;
  }

  /** The output and the setpoint between the limits. */
  take({ output_frequency_hz: output, setpoint_hz, control }) {
    show(this.bar, Boolean(control));
    if (!control) return;
    const { min_hz, max_hz } = control;
    this.top = max_hz;
    const share = (hertz) => `${Math.min(1, Math.max(0, (hertz - min_hz) / (max_hz - min_hz || 1))) * 100}%`;
    text(this.least, number(min_hz));
    text(this.most, number(max_hz));
    const is_known = typeof output === "number";
    this.bar.classList.toggle("none", !is_known);
    attribute(this.fill, "width", is_known ? share(Math.abs(output)) : 0);
    attribute(this.ordered, "x", share(setpoint_hz ?? 0));
    attribute(this.ordered, "display", typeof setpoint_hz === "number" ? null : "none");
  }

  /** Begins with what the gateway has noted. */
  async load() {
    if (this.rows !== null) return;
    this.rows = [];
    this.rows = (await noted(this.drive)).slice(-ROWS);
    this.noted = performance.now();
    this.draw();
  }

  /** What was missed is not known. */
  forget() {
    this.rows = null;
  }

  /** Notes the output of now; null if it is not known. */
  note(now, hertz) {
    if (this.rows === null || now - this.noted < STEP_MS) return;
    const missed = Math.floor((now - this.noted) / STEP_MS) - 1;
    this.noted += STEP_MS * (missed + 1);
    this.rows.push(...new Array(Math.min(ROWS, missed)).fill(null), hertz);
    this.rows = this.rows.slice(-ROWS);
  }

  draw() {
    const rows = (this.rows ?? []).map((hertz) => (typeof hertz === "number" ? Math.abs(hertz) : null));
    const top = Math.max(this.top, ...rows);
    const first = ROWS - rows.length;
    let is_gap = true;
    const place = (hertz, index) => {
      if (hertz === null) return (is_gap = true) && "";
      const part = `${is_gap ? "M" : "L"}${first + index} ${(HEIGHT * (1 - hertz / top)).toFixed(1)}`;
      is_gap = false;
      return part;
    };
    attribute(this.path, "d", rows.map(place).join(""));
  }
}
