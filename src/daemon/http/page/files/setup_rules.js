// The rules of control. What decides over a motor has no default: the person chooses.

import { fill, h, show } from "./dom.js";
import { boxes, field, radios } from "./setup_parts.js";
import { decimal, sentence_of, t, words } from "./texts.js";

const DIRECTIONS = ["forward", "both"].map((value) => ({ value, label: t(`directions.${value}`) }));

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
    this.least = entry("0");
    this.most = entry("50");
    this.lost_after = entry("10");
    this.lost_after.value = "10";
    this.element = h("div", {});
  }

  /** Builds the form for these drives. `is_forced`: that they are commanded is decided. */
  offer({ ways, actions }, drives, is_forced) {
    this.is_forced = is_forced;
    this.drives = drives.filter(({ can_be_commanded }) => can_be_commanded !== false);
    const action = ({ word, meaning }) => ({ value: word, label: words(word), about: sentence_of({ said: { key: `fail_safe.${word}` }, text: meaning }) });
    const choose = (key) => (value) => (this.chosen[key] = value);
    const of = (key, legend, options) => radios(legend, `rule-${key}`, options, choose(key), this.chosen[key]);
    const unproven = this.drives.filter(({ is_unproven }) => is_unproven);
    // What was accepted was accepted for these and for no others.
    const accepts_for = unproven.map(({ station, model }) => `${station} ${model}`).join();
    if (accepts_for !== this.accepts_for) this.accepts.clear();
    this.accepts_for = accepts_for;
    const commanded = new Set(this.drives.map(({ station }) => station).filter((station) => !this.refused.has(station)));
    const drive_boxes = boxes(t("rules.drives"), this.drives.map(({ name, station, is_unproven }) => ({
      value: station, label: name, about: is_unproven ? t("found.unproven") : null,
    })), commanded);
    drive_boxes.addEventListener("change", () => {
      this.refused = new Set(this.drives.map(({ station }) => station).filter((station) => !commanded.has(station)));
    });
    const rules = h(
      "div",
      {},
      boxes(t("rules.from"), ways.map((way) => ({ value: way, label: t(`way.${way}`) })), this.from),
      h("div", { class: "pair" }, field(t("rules.least"), this.least), field(t("rules.most"), this.most)),
      of("directions", t("rules.directions"), DIRECTIONS),
      of("on_commander_lost", t("rules.lost"), actions.map(action)),
      field(t("rules.lost_after"), this.lost_after),
      of("on_shutdown", t("rules.shutdown"), actions.map(action)),
      unproven.length > 0 && boxes(t("rules.unproven"), [{
        value: "yes",
        label: t("rules.accept"),
        about: t("rules.accept_about"),
      }], this.accepts),
      !is_forced && drive_boxes,
    );
    const kinds = [
      { value: "watch", label: t("rules.watch"), about: t("rules.watch_about") },
      { value: "command", label: t("rules.command"), about: t("rules.command_about") },
    ];
    const decide = (value) => {
      this.is_controlled = value === "command";
      show(rules, this.is_controlled);
    };
    const kept = this.is_controlled === null ? null : this.is_controlled ? "command" : "watch";
    if (is_forced) this.is_controlled = true;
    show(rules, this.is_controlled === true);
    fill(this.element, !is_forced && radios(t("rules.control"), "rule-kind", kinds, decide, kept), rules);
  }

  /** What is missing, in a sentence; null if nothing. */
  wrong() {
    if (this.is_controlled === null) return t("rules.choose_control");
    if (!this.is_controlled) return null;
    if (this.from.size === 0) return t("rules.choose_from");
    const [least, most] = [decimal(this.least.value), decimal(this.most.value)];
    if (least === null || most === null || most <= least || most > 1000) return t("rules.wrong_limits");
    if (this.chosen.directions === null) return t("rules.choose_directions");
    if (this.chosen.on_commander_lost === null) return t("rules.choose_lost");
    if (!(Number.isInteger(decimal(this.lost_after.value)) && decimal(this.lost_after.value) >= 1)) return t("rules.choose_lost_after");
    return this.chosen.on_shutdown === null ? t("rules.choose_shutdown") : null;
  }

  /** The rules of the drive at `station`; null if it is only watched. */
  control({ station, is_unproven }) {
    const is_listed = this.drives.some((drive) => drive.station === station);
    const accept_unverified = is_unproven && this.accepts.has("yes");
    const is_left_out = !this.is_forced && (this.refused.has(station) || (is_unproven && !accept_unverified));
    if (!this.is_controlled || !is_listed || is_left_out) return null;
    return {
      from: [...this.from],
      min_frequency_hz: decimal(this.least.value),
      max_frequency_hz: decimal(this.most.value),
      ...this.chosen,
      lost_after_s: decimal(this.lost_after.value),
      accept_unverified,
    };
  }
}

function entry(placeholder) {
  return h("input", { type: "text", inputmode: "decimal", placeholder, autocomplete: "off" });
}
