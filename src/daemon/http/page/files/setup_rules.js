// The rules of control. What decides over a motor has no default: the person chooses.

import { h, show } from "./dom.js";
import { boxes, field, radios } from "./setup_parts.js";

const WAYS = { page: "This page", "modbus-tcp": "A PLC or SCADA system (Modbus TCP)", mqtt: "MQTT, Home Assistant", sparkplug: "Sparkplug" };
const DIRECTIONS = [{ value: "forward", label: "Forward only" }, { value: "both", label: "Forward and reverse" }];

/** The form, which keeps what was chosen while one goes back and forth. */
export class Rules {
  constructor() {
    this.is_controlled = null;
    this.from = new Set();
    // Stations, because a drive may be renamed between two steps.
    this.refused = new Set();
    this.chosen = { directions: null, on_commander_lost: null, on_shutdown: null };
    this.accepts = new Set();
    this.accepts_for = "";
    this.least = number("0");
    this.most = number("50");
    this.lost_after = number("10");
    this.lost_after.value = "10";
    this.element = h("div", {});
  }

  /** Builds the form for these drives. `is_forced`: that they are commanded is decided. */
  offer({ ways, actions }, drives, is_forced) {
    this.is_forced = is_forced;
    this.drives = drives.filter(({ can_be_commanded }) => can_be_commanded !== false);
    const action = ({ word, meaning }) => ({ value: word, label: word, about: meaning });
    const choose = (key) => (value) => (this.chosen[key] = value);
    const of = (key, legend, options) => radios(legend, `rule-${key}`, options, choose(key), this.chosen[key]);
    const unproven = this.drives.filter(({ is_unproven }) => is_unproven);
    // What was accepted was accepted for these and for no others.
    const accepts_for = unproven.map(({ station, model }) => `${station} ${model}`).join();
    if (accepts_for !== this.accepts_for) this.accepts.clear();
    this.accepts_for = accepts_for;
    const commanded = new Set(this.drives.map(({ station }) => station).filter((station) => !this.refused.has(station)));
    const drive_boxes = boxes("Drives that may be commanded", this.drives.map(({ name, station, is_unproven }) => ({
      value: station, label: name, about: is_unproven ? "no manual proves its stop" : null,
    })), commanded);
    drive_boxes.addEventListener("change", () => {
      this.refused = new Set(this.drives.map(({ station }) => station).filter((station) => !commanded.has(station)));
    });
    const rules = h(
      "div",
      {},
      boxes("From where", ways.map((way) => ({ value: way, label: WAYS[way] ?? way })), this.from),
      h("div", { class: "pair" }, field("Lowest frequency, Hz", this.least), field("Highest frequency, Hz", this.most)),
      of("directions", "Directions", DIRECTIONS),
      of("on_commander_lost", "When the commander is lost", actions.map(action)),
      field("How long it may be silent before that, in seconds", this.lost_after),
      of("on_shutdown", "When the gateway is shut down", actions.map(action)),
      unproven.length > 0 && boxes("Stop not proven", [{
        value: "yes",
        label: "Take orders all the same",
        about: "No manual proves how these are stopped. See a stop work at the drive before you rely on it.",
      }], this.accepts),
      !is_forced && drive_boxes,
    );
    const kinds = [
      { value: "watch", label: "Only watch", about: "No client may command them." },
      { value: "command", label: "They may be commanded", about: "One at a time, within limits." },
    ];
    const decide = (value) => {
      this.is_controlled = value === "command";
      show(rules, this.is_controlled);
    };
    const kept = this.is_controlled === null ? null : this.is_controlled ? "command" : "watch";
    if (is_forced) this.is_controlled = true;
    show(rules, this.is_controlled === true);
    this.element.replaceChildren(is_forced ? "" : radios("Control", "rule-kind", kinds, decide, kept), rules);
  }

  /** What is missing, in a sentence; null if nothing. */
  wrong() {
    if (this.is_controlled === null) return "Choose whether the drives may be commanded.";
    if (!this.is_controlled) return null;
    if (this.from.size === 0) return "Choose from where they may be commanded.";
    const [least, most] = [this.least.valueAsNumber, this.most.valueAsNumber];
    if (!(least >= 0 && most > least && most <= 1000)) return "The lowest and the highest frequency are missing, or exchanged.";
    if (this.chosen.directions === null) return "Choose the directions.";
    if (this.chosen.on_commander_lost === null) return "Choose what happens when the commander is lost.";
    if (!(Number.isInteger(this.lost_after.valueAsNumber) && this.lost_after.valueAsNumber >= 1)) return "How many whole seconds may the commander be silent?";
    return this.chosen.on_shutdown === null ? "Choose what happens when the gateway is shut down." : null;
  }

  /** The rules of the drive at `station`; null if it is only watched. */
  control({ station, is_unproven }) {
    const is_listed = this.drives.some((drive) => drive.station === station);
    const accept_unverified = is_unproven && this.accepts.has("yes");
    const is_left_out = !this.is_forced && (this.refused.has(station) || (is_unproven && !accept_unverified));
    if (!this.is_controlled || !is_listed || is_left_out) return null;
    return {
      from: [...this.from],
      min_frequency_hz: this.least.valueAsNumber,
      max_frequency_hz: this.most.valueAsNumber,
      ...this.chosen,
      lost_after_s: this.lost_after.valueAsNumber,
      accept_unverified,
    };
  }
}

function number(placeholder) {
  return h("input", { type: "number", inputmode: "decimal", min: "0", step: "0.01", placeholder, autocomplete: "off" });
}
