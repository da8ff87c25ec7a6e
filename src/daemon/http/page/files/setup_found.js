// The drives that a scan has found: which model each is, what it is called, and what it shows now.

import { fill, h, show, text } from "./dom.js";
import { field, radios } from "./setup_parts.js";
import * as session from "./session.js";
import { decimal, t, words } from "./texts.js";

/** One drive that can be added. */
class FoundDrive {
  constructor({ station, confidence, models, other }) {
    this.station = station;
    this.models = models;
    this.is_added = true;
    this.model = models.length === 1 ? models[0] : null;
    this.name = h("input", { type: "text", value: `drive-${station}`, autocapitalize: "off", autocomplete: "off" });
    this.full_scale = h("input", { type: "text", inputmode: "decimal", autocomplete: "off" });
    this.values = h("div", { role: "status" });
    this.scale_field = field(t("found.full_scale"), this.full_scale);
    const add = h("input", { type: "checkbox", checked: true, change: ({ target }) => this.add(target.checked) });
    const look = h("button", { type: "button", class: "plain", click: () => this.look(look) }, t("found.panel"));
    const option = (model) => ({ value: model.id, label: `${model.vendor} ${model.title}`, about: about(model) });
    const choose = (id) => this.choose(models.find((model) => model.id === id));
    const legend = models.length === 1 ? t("found.model", { confidence: words(confidence) }) : t("found.models");
    this.rest = h(
      "div",
      { class: "rest" },
      other && h("p", { class: "wrong" }, t("found.says_other", { other })),
      radios(legend, `model-${station}`, models.map(option), choose, this.model?.id),
      field(t("found.name"), this.name),
      this.scale_field,
      look,
      this.values,
    );
    this.element = h("section", { class: "part", "aria-label": t("setup.station", { station }) },
      h("label", { class: "option" }, add, h("span", {}, h("b", {}, t("setup.station", { station })), h("small", {}, t("found.add")))), this.rest);
    this.choose(this.model);
  }

  add(is) {
    this.is_added = is;
    show(this.rest, is);
  }

  choose(model) {
    this.model = model ?? null;
    show(this.scale_field, this.model?.needs_full_scale === true);
    this.full_scale.placeholder = this.model?.full_scale_parameter ?? "";
  }

  /** What its candidates make of its registers: the person at the panel sees which one is right. */
  async look(button) {
    button.disabled = true;
    text(this.values, t("found.reading"));
    const models = this.model ? [this.model] : this.models.slice(0, 4);
    const { answer, error } = await session.set_up("POST", "/values", { station: this.station, models: models.map(({ id }) => id) });
    button.disabled = false;
    if (error !== null) return text(this.values, error);
    const name = (id) => models.find((model) => model.id === id)?.title ?? id;
    const row = ({ label, text: value, why }) => h("div", { class: "value" }, h("dt", {}, label), h("dd", {}, value?.replace("degC", "°C") ?? why));
    const part = ({ id, values }) => h("div", {}, h("h4", {}, name(id)), h("dl", {}, ...values.map(row)));
    return fill(this.values, ...answer.models.map(part));
  }

  /** What is missing, in a sentence; null if nothing. */
  wrong() {
    if (!this.is_added) return null;
    if (!this.model) return t("found.choose", { station: this.station });
    if (!/^(?!\.*$)[A-Za-z0-9._-]{1,64}$/.test(this.name.value)) return t("found.name_wrong", { station: this.station });
    const hz = decimal(this.full_scale.value);
    if (this.model.needs_full_scale && !(hz >= 1 && hz <= 1000)) return t("found.scale_wrong", { station: this.station });
    return null;
  }
}

function about({ id, why, is_unproven, can_be_commanded }) {
  const parts = [id, why];
  if (!can_be_commanded) parts.push(t("found.only_watched"));
  else if (is_unproven) parts.push(t("found.unproven"));
  return parts.join("; ");
}

/** All of them. */
export class Found {
  constructor(scan) {
    const is_known = ({ is_here, models }) => is_here === true && models.length > 0;
    const known = scan.drives.filter(is_known).sort((one, other) => one.station - other.station);
    this.all = known.map((drive) => new FoundDrive(drive));
    const others = scan.drives.filter((drive) => !is_known(drive)).map((drive) => other_text(drive, scan.link));
    const damaged = scan.damaged.map(({ station, at }) => t("found.damaged", { station, at }));
    const notes = [...others, ...damaged];
    if (scan.echoes) notes.push(t("found.echoes"));
    if (scan.drives.length === 0) notes.push(t("found.silence"));
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
      full_scale_hz: model.needs_full_scale ? decimal(full_scale.value) : null,
      is_unproven: model.is_unproven,
      can_be_commanded: model.can_be_commanded,
    }));
  }

  wrong() {
    const added = this.all.filter(({ is_added }) => is_added);
    if (added.length === 0) return t("found.none_added");
    const names = added.map(({ name }) => name.value);
    const twice = names.find((name, at) => names.indexOf(name) !== at);
    if (twice !== undefined) return t("found.twice", { name: twice });
    return this.all.map((drive) => drive.wrong()).find((wrong) => wrong !== null) ?? null;
  }
}

function other_text({ station, at, models, other }, link) {
  const name = other ?? models.map(({ title }) => title).join(" / ");
  return models.length === 0 ? t("found.no_model", { station, at }) : t("found.elsewhere", { station, at, name, link });
}
