// The choice of the language.

import { add, h } from "./dom.js";
import { LANGUAGES, choose, language } from "./texts.js";

/** Fills the choice inside `select`. */
export function start(select) {
  const option = ([code, name]) => h("option", { value: code, lang: code, selected: code === language }, name);
  add(select, ...Object.entries(LANGUAGES).map(option));
  select.addEventListener("change", () => choose(select.value));
}
