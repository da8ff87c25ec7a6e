// What commands a drive from its card.

import { announce, attribute, h, show, text } from "./dom.js";
import { Hold } from "./hold.js";
import * as leases from "./leases.js";
import * as session from "./session.js";
import { clock, decimal, number, t, words } from "./texts.js";

/** How long it is told how a command ended. */
const TOLD_MS = { good: 20_000, bad: 60_000, pending: Infinity };
const TAKEN = new Set(["acknowledged", "confirmed", "unknown"]);
const ACTIONS = [
  ["standstill", t("action.standstill"), "plain across", {}],
  ["reverse", t("action.reverse"), "run", { run: "reverse" }],
  ["forward", t("action.forward"), "run", { run: "forward" }],
  ["reset", t("action.reset"), "plain", { reset: true }],
  ["take", t("action.take"), "plain", { take: true }],
];

/** The controls of one drive. */
export class Controls {
  /** `told` is called when there is another result. */
  constructor(drive, told) {
    this.drive = drive;
    this.shown = drive;
    this.told = told;
    this.told_at = -Infinity;
    this.kind = "good";
    this.control = null;
    this.may_be_tripped = false;
    this.is_live = false;
    this.is_from_page = false;
    /** Whether the result says that a stop is pending, and whether the gateway has shown that since. */
    this.awaits_stop = false;
    this.was_pending = false;
    this.stop = h("button", { type: "button", class: "stop", click: () => this.send("stop", { run: "stop" }) }, t("action.stop"));
    this.coast = h("button", { type: "button", class: "coast", click: () => this.send("coast", { run: "coast" }) }, t("action.coast"));
    this.input = h("input", {
      type: "text",
      inputmode: "decimal",
      autocomplete: "off",
      id: `setpoint-${drive}`,
      "aria-describedby": `range-${drive}`,
      input: () => this.draw(),
    });
    this.set = h("button", { type: "submit", class: "plain" }, t("action.set"));
    this.hint = h("span", { id: `range-${drive}` });
    const submit = (event) => {
      event.preventDefault();
      if (this.is_live && this.draft() !== null) this.send("setpoint", {});
    };
    this.form = h(
      "form",
      { class: "setpoint", novalidate: true, submit },
      h("label", { for: this.input.id }, t("drive.setpoint")),
      h("span", { class: "entry" }, this.input, "Hz"),
      this.set,
      this.hint,
    );
    this.holds = new Map(
      ACTIONS.map(([word, label, kind, body]) => [word, new Hold(label, kind, () => this.send(word, { ...body }))]),
    );
    const buttons = [...this.holds.values()].map((hold) => hold.element);
    this.result = h("p", { class: "result", tabindex: "0" });
    this.stops = h("div", { class: "stops", role: "group" }, this.stop);
    this.element = h(
      "div",
      { class: "controls", role: "group" },
      this.form,
      h("div", { class: "holds" }, ...buttons, this.coast),
    );
  }

  /** This is what people call the drive. */
  rename(shown) {
    this.shown = shown;
    // What was begun under another name was meant for another motor.
    this.holds.forEach((hold) => hold.enable(false));
    this.input.value = "";
    const labels = [[this.stop, "action.stop_drive"], [this.coast, "action.coast_drive"], [this.stops, "drive.stops"], [this.element, "drive.control"]];
    for (const [element, key] of labels) attribute(element, "aria-label", t(key, { drive: shown }));
  }

  /** What was typed and not sent yet, in Hz; null if nothing or nothing useful. */
  draft() {
    const value = decimal(this.input.value);
    if (value === null || !this.control) return null;
    return value >= this.control.min_hz && value <= this.control.max_hz ? value : null;
  }

  update({ control, trip, presence, group, standby, may_still_run, run_state }, is_live) {
    this.control = control;
    this.follow_stop(control, run_state);
    this.may_still_run = may_still_run === true;
    this.may_be_tripped = trip?.active === true || (trip?.active !== false && presence === "online");
    // A stop goes to the line, which decides.
    this.is_live = is_live && standby !== "listening";
    const is_from_page = control?.from?.includes("page") === true;
    show(this.stops, is_from_page && session.may_stop());
    // A user who may command may say that a motor stands, also of a drive that is not commanded from here.
    this.may_command = session.may_command(group ?? null);
    // To coast is to stop, which those may too who command other drives alone.
    const may_coast = is_from_page && session.may_stop() && control.can.includes("coast");
    this.is_offered_at_all = may_coast || ((is_from_page || this.may_still_run) && this.may_command);
    this.is_from_page = is_from_page;
    if (control || this.may_still_run) this.draw();
  }

  /** A result that says that a stop is pending is not left standing once it is not. */
  follow_stop(control, run_state) {
    if (!this.awaits_stop) return;
    const is_pending = control?.stop_pending === true;
    this.was_pending ||= is_pending;
    if (is_pending || !this.was_pending) return;
    this.awaits_stop = false;
    if (run_state === "stopped") this.tell("good", t("stop.effective"));
    else {
      text(this.result, "");
      this.told_at = -Infinity;
      this.told();
    }
  }

  /** The kind of the result, as long as it is told; null without one. */
  told_kind() {
    return performance.now() - this.told_at < TOLD_MS[this.kind] ? this.kind : null;
  }

  draw() {
    const { can = [], min_hz, max_hz, lost_after_s, on_commander_lost, site } = this.is_from_page ? this.control : {};
    const draft = this.draft();
    const is_wrong = this.input.value !== "" && draft === null;
    this.input.setAttribute("aria-invalid", String(is_wrong));
    this.set.setAttribute("aria-disabled", String(!this.is_live || draft === null));
    this.input.placeholder = t("range", { least: min_hz, most: max_hz });
    text(this.hint, t(is_wrong ? "range.wrong" : "range.hz", { least: min_hz, most: max_hz }));
    this.hint.className = is_wrong ? "range wrong" : "range unseen";
    show(this.form, this.may_command && can.includes("frequency"));
    show(this.coast, can.includes("coast"));
    const seen = site?.length ? ` ${t("control.seen", { actions: site.map(words).join(", ") })}` : "";
    const title = `${t("control.lost", { action: words(on_commander_lost), seconds: lost_after_s })}${seen}`;
    if (this.form.title !== title) this.form.title = title;
    for (const [word, label, kind] of ACTIONS) {
      const hold = this.holds.get(word);
      const is_offered = this.is_offered(word, kind, can);
      show(hold.element, is_offered);
      // What would be run at a number that is not allowed is not run at all.
      const is_on = is_offered && this.is_live && this.is_useful(word) && !(kind === "run" && is_wrong);
      if (hold.is_off === is_on || !hold.element.hasAttribute("aria-disabled")) hold.enable(is_on);
      hold.rename(kind === "run" && draft !== null ? t("action.at", { action: label, hertz: draft }) : label);
    }
  }

  /** In place of starting a drive that is out of sight, a person can say that its motor stands. */
  is_offered(word, kind, can) {
    if (word === "standstill") return this.may_still_run && this.may_command;
    return this.may_command && can.includes(word) && !(kind === "run" && this.may_still_run);
  }

  /** There is something to reset, or to take. */
  is_useful(word) {
    if (word === "reset") return this.may_be_tripped;
    if (word === "take") return Boolean(this.control?.owner) && leases.every_ms(this.drive) === null;
    return true;
  }

  async send(word, body) {
    const draft = this.draft();
    if (draft !== null && (word === "setpoint" || body.run === "forward" || body.run === "reverse")) {
      body.frequency_hz = draft;
    }
    this.tell("pending", t("command.sent", { command: words(word) }));
    const lost_after_s = this.control?.lost_after_s;
    const answer = word === "standstill" ? await session.standstill(this.drive) : await session.command(this.drive, body);
    const { outcome } = answer;
    const is_good = outcome === "acknowledged" || outcome === "confirmed";
    this.tell(is_good ? "good" : "bad", `${words(word)} ${session.outcome_text(answer)}`, !is_good);
    if (is_good && body.frequency_hz !== undefined && this.draft() === body.frequency_hz) this.input.value = "";
    const is_stop = word === "stop" || word === "coast";
    this.awaits_stop = is_stop && outcome === "unknown";
    this.was_pending = false;
    if (TAKEN.has(outcome) && !is_stop && word !== "reset" && word !== "standstill") leases.begin(this.drive, lost_after_s);
    this.draw();
  }

  tell(kind, message, is_urgent = false) {
    this.kind = kind;
    this.told_at = performance.now();
    this.result.className = `result ${kind}`;
    text(this.result, `${clock(Date.now())} ${message}`);
    this.told();
    if (kind !== "pending") announce(`${this.shown}: ${message}`, is_urgent);
  }
}
