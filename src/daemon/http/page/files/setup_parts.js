// What the steps of set-up are built of.

import { add, h, prose, shape } from "./dom.js";
import { learn } from "./texts.js";

/** What only set-up needs is fetched with it. */
async function dress() {
  const sheet = h("link", { rel: "stylesheet", href: "assets/setup.css" });
  const done = new Promise((done) => ["load", "error"].forEach((event) => sheet.addEventListener(event, done)));
  add(document.head, sheet);
  await done;
}

await Promise.all([learn("setup"), dress()]);

let last = 0;

/** A control with its label above it, and what helps to fill it in. */
export function field(label, control, help = null) {
  last += 1;
  control.id ||= `setup-${last}`;
  if (help) control.setAttribute("aria-describedby", `${control.id}-help`);
  const below = help && h("small", { id: `${control.id}-help` }, help);
  return h("div", { class: "field" }, h("label", { for: control.id }, label), control, below);
}

/** A button over the whole width. It does nothing more while it is at work. */
export function wide(label, act, kind = null) {
  const button = h("button", { type: "button", class: kind ? `wide ${kind}` : "wide" }, label);
  button.addEventListener("click", async () => {
    if (button.disabled) return;
    button.disabled = true;
    try {
      await act();
    } finally {
      button.disabled = false;
    }
  });
  return button;
}

/** Choices of which one is taken; none is to begin with. */
export function radios(legend, name, options, choose, chosen = null) {
  const option = ({ value, label, about = null }) => {
    const radio = h("input", { type: "radio", name, value, checked: value === chosen, change: () => choose(value) });
    return h("label", { class: "option" }, radio, h("span", {}, h("b", {}, label), about && h("small", {}, about)));
  };
  return h("fieldset", { class: "options" }, h("legend", {}, legend), ...options.map(option));
}

/** Choices of which several are taken. */
export function boxes(legend, options, chosen) {
  const option = ({ value, label, about = null }) => {
    const change = ({ target }) => (target.checked ? chosen.add(value) : chosen.delete(value));
    const box = h("input", { type: "checkbox", checked: chosen.has(value), change });
    return h("label", { class: "option" }, box, h("span", {}, h("b", {}, label), about && h("small", {}, about)));
  };
  return h("fieldset", { class: "options" }, h("legend", {}, legend), ...options.map(option));
}

const SHAPES = { problem: "problem", hint: "advice", good: "good" };

/** Sentences below a heading; nothing where there is none. */
export function list(title, sentences, kind) {
  if (sentences.length === 0) return false;
  const item = (sentence) => h("li", { class: kind }, shape(SHAPES[kind]), h("span", {}, ...prose(sentence)));
  return h("div", {}, h("h4", {}, title), h("ul", { class: "advice" }, ...sentences.map(item)));
}

/** A text with the numbers of its lines. */
export function numbered(text, first) {
  const lines = text.trimEnd().split("\n");
  const wide_as = String(first + lines.length).length;
  return lines.map((line, at) => `${String(first + at).padStart(wide_as)}  ${line}`).join("\n");
}
