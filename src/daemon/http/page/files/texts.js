// Sentences, numbers and times in the language of the reader. A sentence has a key in the catalogue of each language, of
// which each part of the page fetches the chapter that it shows.

import { keep, kept } from "./kept.js";

/** Languages by their codes. Each has a catalogue. */
export const LANGUAGES = { en: "English", de: "Deutsch" };

const KEPT = "vfd-gateway-language";
const RETRY_MS = 1000;

const known = (code) => Object.hasOwn(LANGUAGES, code ?? "");
const primary = (tag) => tag.split("-")[0].toLowerCase();

/** The language that is shown: the one that was chosen here, else the first of the browser's that has a catalogue. */
export const language = [kept(KEPT), ...navigator.languages.map(primary)].find(known) ?? "en";

/** For numbers and dates: the browser's own kind of the language, such as de-CH. */
export const locale = navigator.languages.find((tag) => primary(tag) === language) ?? language;

/** Shows another language from now on. */
export function choose(code) {
  keep(KEPT, code);
  location.reload();
}

const catalogue = {};

/** Fetches a chapter of the catalogue. Without it there is nothing to read, so it is asked for until it comes. */
export async function learn(chapter) {
  for (;;) {
    const response = await fetch(`assets/${chapter}.${language}.json`).catch(() => null);
    const sentences = response?.ok ? await response.json().catch(() => null) : null;
    if (sentences) return Object.assign(catalogue, sentences);
    await new Promise((done) => setTimeout(done, RETRY_MS));
  }
}

// The gateway's own sentences come in English with its documents.
await Promise.all([learn("page"), language !== "en" && learn("gateway")]);
const plural = new Intl.PluralRules(language);

/** The sentence of `key` with its values. Of a sentence with `{count}` there may be one for each plural of the language. */
export function t(key, values = {}) {
  const of_count = () => catalogue[`${key}.${plural.select(values.count)}`] ?? catalogue[`${key}.other`];
  const sentence = catalogue[key] ?? of_count() ?? key;
  return sentence.replace(/\{(\w+)\}/g, (_, name) => part(values[name]));
}

function part(value) {
  if (typeof value === "number") return number(value);
  return value?.key ? t(value.key, value.values) : value ?? "";
}

/** What the gateway says, in the language of the reader; as the gateway wrote it where it has no key for it. */
export function sentence_of({ said, text }) {
  return said && catalogue[said.key] ? t(said.key, said.values) : text;
}

/** A word of a document as people read it. */
export function words(word) {
  if (word === null || word === undefined) return "";
  return catalogue[`word.${word}`] ?? String(word).replaceAll("_", " ");
}

/** What a value is for, such as `output_current`. */
export function role(word) {
  return catalogue[`role.${word}`] ?? words(word);
}

/** The name of a value: in the words of its manual, unless the language has its own for what it is for. */
export function value_label({ role: of, label, name }) {
  return catalogue[`role.${of}`] ?? (label || words(name));
}

/** Puts the sentences into the parts of the page that are there from the beginning. */
export function translate(root) {
  document.documentElement.lang = language;
  for (const element of root.querySelectorAll("[data-t]")) element.textContent = t(element.dataset.t);
  for (const element of root.querySelectorAll("[data-t-label]")) element.setAttribute("aria-label", t(element.dataset.tLabel));
}

const formats = new Map();

/** Without marks between thousands: in one language they are the decimal sign of another. */
function format(least, most) {
  const key = `${least} ${most}`;
  if (!formats.has(key)) {
    formats.set(key, new Intl.NumberFormat(locale, { minimumFractionDigits: least, maximumFractionDigits: most, useGrouping: false }));
  }
  return formats.get(key);
}

/** A number with as many decimals as `decimals`, or a dash where there is none. */
export function number(value, decimals = null) {
  if (typeof value !== "number" || !Number.isFinite(value)) return "–";
  return format(decimals ?? 0, decimals ?? 3).format(value);
}

/** The number that was typed, with one decimal sign and at most two decimals; null if it is anything else. A point or a
 * comma is the decimal sign in every language, so that no number is taken for a thousand times another. */
export function decimal(typed) {
  const match = /^(\d{1,6})(?:[.,](\d{1,2}))?$/.exec(typed.trim());
  return match ? Number(`${match[1]}.${match[2] ?? 0}`) : null;
}

const UNITS = { degC: "°C", "m3/h": "m³/h", "-": "" };

/** A unit as people write it. */
export function unit(symbol) {
  return UNITS[symbol] ?? symbol ?? "";
}

/** Milliseconds as a short span of time. */
export function span(ms) {
  if (typeof ms !== "number" || !Number.isFinite(ms)) return "–";
  if (ms < 10_000) return t("seconds", { seconds: number(ms / 1000, 1) });
  const s = Math.floor(ms / 1000);
  if (s < 120) return t("seconds", { seconds: s });
  if (s < 7200) return t("minutes", { minutes: Math.floor(s / 60) });
  return s < 172_800 ? t("hours", { hours: Math.floor(s / 3600) }) : t("days", { days: Math.floor(s / 86_400) });
}

const two = (value) => String(value).padStart(2, "0");

/** The time of day, here. */
export function clock(at, milliseconds = false) {
  const date = new Date(at);
  if (Number.isNaN(date.getTime())) return "–";
  const time = `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
  return milliseconds ? `${time}.${String(date.getMilliseconds()).padStart(3, "0")}` : time;
}

const DAY = new Intl.DateTimeFormat(locale, { year: "numeric", month: "short", day: "numeric" });

/** Day and time, here. */
export function moment(at) {
  const date = new Date(at);
  return Number.isNaN(date.getTime()) ? "–" : `${DAY.format(date)} ${clock(at)}`;
}

/** The time of day, and the day too unless that is today. */
export function recent(at) {
  const is_today = new Date(at).toDateString() === new Date().toDateString();
  return is_today ? clock(at) : moment(at);
}
