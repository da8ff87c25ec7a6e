// What is asked for rather than told: documents of the gateway, and choices that follow its drives and lines.

import { fill, h, same } from "./dom.js";
import { t } from "./texts.js";
import { called } from "./titles.js";

const TIMEOUT_MS = 15_000;

/** A document, or a sentence that says why there is none. A panel whose documents are not served at all is told so. */
export async function document_at(path, panel) {
  try {
    const response = await fetch(path, { cache: "no-store", signal: AbortSignal.timeout(TIMEOUT_MS) });
    const answer = await response.json().catch(() => null);
    if (response.ok && answer) return { answer };
    if (response.status === 404 && !answer) panel.dispatchEvent(new Event("missing"));
    return { error: answer?.error ?? t("gateway.answered", { status: response.status }) };
  } catch {
    return { error: t("gateway.no_answer") };
  }
}

/** A path with those parameters that have a value. */
export function query(path, parameters) {
  const given = Object.entries(parameters).filter(([, value]) => value !== "" && value !== null);
  return given.length > 0 ? `${path}?${new URLSearchParams(given)}` : path;
}

/** Brings the options of a select in line with `names`, which are of `drives` or `lines`, and keeps what was chosen. */
export function choices(select, kind, names, first = null) {
  const wanted = [...(first === null ? [] : [["", first]]), ...names.map((name) => [name, called(kind, name)])];
  const there = [...select.options].map(({ value, textContent }) => [value, textContent]);
  if (same(there, wanted)) return;
  const chosen = select.value;
  fill(select, ...wanted.map(([value, label]) => h("option", { value }, label)));
  if (wanted.some(([value]) => value === chosen)) select.value = chosen;
}

/** A select with its label. */
export function labelled(label, control) {
  return h("label", { class: "choice" }, h("span", {}, label), control);
}

/** A table with these headings; `numeric` names the columns that hold numbers. */
export function table(caption, headings, numeric = []) {
  const body = h("tbody");
  const head = headings.map((heading) => h("th", { scope: "col", class: numeric.includes(heading) ? "numeric" : null }, heading));
  const element = h("table", {}, h("caption", { class: "unseen" }, caption), h("thead", {}, h("tr", {}, ...head)), body);
  /** A row; each cell knows its heading, for those who see one below the other. */
  const row = (cells, kind = null) => {
    const cell = (heading, index) => h("td", { "data-label": heading, class: numeric.includes(heading) ? "numeric" : null }, cells[index] ?? "");
    return h("tr", { class: kind }, ...headings.map(cell));
  };
  return { element, body, row };
}
