// The drives that a scan has found: which model each is, what it is called, and what it shows now.

import { h, show, text } from "./dom.js";
import { field, radios } from "./setup_parts.js";
import * as session from "./session.js";

/** One drive that can be added. */
class FoundDrive {
  constructor({ station, confidence, models, other }) {
    this.station = station;
    this.models = models;
    this.is_added = true;
    this.model = models.length === 1 ? models[0] : null;
    this.name = h("input", { type: "text", value: `drive-${station}`, autocapitalize: "off", autocomplete: "off" });
    this.full_scale = h("input", { type: "number", inputmode: "decimal", min: "1", max: "1000", step: "0.01", autocomplete: "off" });
    this.values = h("div", { role: "status" });
    this.scale_field = field("Frequency that stands for 100 % at the drive, in Hz", this.full_scale);
    const add = h("input", { type: "checkbox", checked: true, change: ({ target }) => this.add(target.checked) });
    const look = h("button", { type: "button", class: "plain", click: () => this.look(look) }, "What does the panel show?");
    const option = (model) => ({ value: model.id, label: `${model.vendor} ${model.title}`, about: about(model) });
    const choose = (id) => this.choose(models.find((model) => model.id === id));
    const legend = models.length === 1 ? `Model (${confidence})` : "Model: which is on the nameplate?";
    this.rest = h(
      "div",
      { class: "rest" },
      other && h("p", { class: "wrong" }, `It says that it is ${other}.`),
      radios(legend, `model-${station}`, models.map(option), choose, this.model?.id),
      field("Name", this.name),
      this.scale_field,
      look,
      this.values,
    );
    this.element = h("section", { class: "part", "aria-label": `Station ${station}` },
      h("label", { class: "option" }, add, h("span", {}, h("b", {}, `Station ${station}`), h("small", {}, "add it"))), this.rest);
    this.choose(this.model);
  }

  add(is) {
    this.is_added = is;
    show(this.rest, is);
  }

  choose(model) {
    this.model = model ?? null;
    show(this.scale_field, this.model?.needs_full_scale === true);
  }

  /** What its candidates make of its registers: the person at the panel sees which one is right. */
  async look(button) {
    button.disabled = true;
    text(this.values, "Reading.");
    const models = this.model ? [this.model] : this.models.slice(0, 4);
    const { answer, error } = await session.set_up("POST", "/values", { station: this.station, models: models.map(({ id }) => id) });
    button.disabled = false;
    if (error !== null) return text(this.values, error);
    const name = (id) => models.find((model) => model.id === id)?.title ?? id;
    const row = ({ label, text: value, why }) => h("div", { class: "value" }, h("dt", {}, label), h("dd", {}, value?.replace("degC", "°C") ?? why));
    const part = ({ id, values }) => h("div", {}, h("h4", {}, name(id)), h("dl", {}, ...values.map(row)));
    return this.values.replaceChildren(...answer.models.map(part));
  }

  /** What is missing, in a sentence; null if nothing. */
  wrong() {
    if (!this.is_added) return null;
    if (!this.model) return `Choose the model of station ${this.station}.`;
    if (!/^[A-Za-z0-9._-]{1,64}$/.test(this.name.value)) return `The name of station ${this.station} needs 1 to 64 letters, digits, "-", "_" or ".".`;
    const hz = this.full_scale.valueAsNumber;
    if (this.model.needs_full_scale && !(hz >= 1 && hz <= 1000)) return `Station ${this.station}: the frequency for 100 % is missing.`;
    return null;
  }
}

function about({ id, why, is_unproven, can_be_commanded }) {
  const parts = [id, why];
  if (!can_be_commanded) parts.push("can only be watched");
  else if (is_unproven) parts.push("no manual proves its stop");
  return parts.join("; ");
}

/** All of them. */
export class Found {
  constructor(scan) {
    const is_known = ({ is_here, models }) => is_here === true && models.length > 0;
    const known = scan.drives.filter(is_known).sort((one, other) => one.station - other.station);
    this.all = known.map((drive) => new FoundDrive(drive));
    const others = scan.drives.filter((drive) => !is_known(drive)).map((drive) => other_text(drive, scan.link));
    const damaged = scan.damaged.map(({ station, at }) => `Something answers as station ${station} at ${at}, but damaged: another parity or speed, two devices with one number, or a bad cable.`);
    const notes = [...others, ...damaged];
    if (scan.echoes) notes.push("The adapter sends back what is sent. Better switch that off there.");
    if (scan.drives.length === 0) notes.push("Is the drive switched on, set to RS-485 and to a station among those that were asked? Are A and B exchanged?");
    this.element = h("div", {}, ...this.all.map(({ element }) => element), ...notes.map((note) => h("p", { class: "message" }, note)));
  }

  count() {
    return this.all.length;
  }

  /** Those that are added. */
  drives() {
    return this.all.filter(({ is_added }) => is_added).map(({ name, station, model, full_scale }) => ({
      name: name.value,
      station,
      model: model.id,
      full_scale_hz: model.needs_full_scale ? full_scale.valueAsNumber : null,
      is_unproven: model.is_unproven,
      can_be_commanded: model.can_be_commanded,
    }));
  }

  wrong() {
    const added = this.all.filter(({ is_added }) => is_added);
    if (added.length === 0) return "No drive is to be added.";
    const names = added.map(({ name }) => name.value);
    const twice = names.find((name, at) => names.indexOf(name) !== at);
    if (twice !== undefined) return `Two drives are called ${twice}.`;
    return this.all.map((drive) => drive.wrong()).find((wrong) => wrong !== null) ?? null;
  }
}

function other_text({ station, at, models, other }, link) {
  const name = other ?? (models.map(({ title }) => title).join(" or ") || "no known model");
  return models.length === 0 ? `Station ${station} answers at ${at}, but fits no model.` : `Station ${station} answers at ${at} (${name}): set it to ${link} first.`;
}
