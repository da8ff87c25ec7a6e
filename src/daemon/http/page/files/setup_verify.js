// Whether a drive is set to obey the bus; what is not can be set from here, by a button that is held.

import { fill, h, text } from "./dom.js";
import { Hold } from "./hold.js";
import { wide } from "./setup_parts.js";
import * as session from "./session.js";
import { t, words } from "./texts.js";

/** The part for the drive called `name`. */
export function verify(name) {
  const path = `/drives/${encodeURIComponent(name)}`;
  const seen = h("div", { class: "scroll", role: "status" });
  const look = async () => {
    text(seen, t("found.reading"));
    const { answer, error } = await session.set_up("GET", path);
    if (error !== null) text(seen, error);
    else fill(seen, ...shown(answer, (addresses) => set(addresses)));
  };
  // The outcome of a write stays above what is read after it.
  const set = async (addresses) => {
    text(seen, t("verify.setting"));
    const { answer, error, is_unknown } = await session.set_up("POST", path, { addresses });
    const is_good = answer?.outcome === "confirmed";
    const unknown = is_unknown ? ` ${t("verify.unknown")}` : "";
    const told = error === null ? `${words(answer.outcome)}: ${answer.message}` : `${error}${unknown}`;
    await look();
    seen.prepend(h("p", { class: is_good ? "message" : "wrong", role: "alert" }, told));
  };
  return h("section", { class: "part", "aria-label": name }, h("b", {}, name), wide(t("verify.verify"), look), seen);
}

function shown({ right, identity, items }, set) {
  const wrong = items.filter(({ result, address }) => result === "wrong" && address !== null);
  const row = ({ what, text: sentence, found, wanted, result }) => h(
    "tr", { class: result === "wrong" ? "wrong" : null },
    h("td", { "data-label": t("heading.setting") }, `${what}: ${sentence}`),
    h("td", { "data-label": t("heading.now") }, value(found)),
    h("td", { "data-label": t("heading.result") }, result === "right" ? words("right") : t("verify.must_be", { result: words(result), wanted: wanted.map(value).join(" / ") })),
  );
  const hold = new Hold(t("verify.set", { count: wrong.length }), "run", () => set(wrong.map(({ address }) => address)));
  const is_other = identity !== null && identity.result !== "right";
  return [
    h("p", {}, t(right ? "verify.obeys" : "verify.not_known")),
    is_other && h("p", { class: "wrong" }, t("verify.identity", { result: `${words(identity.result)}${identity.other ? `: ${identity.other}` : ""}` })),
    items.length > 0 && h("table", {}, h("tbody", {}, ...items.map(row))),
    wrong.length > 0 && h("p", { class: "message" }, t("verify.writes")),
    wrong.length > 0 && hold.element,
  ];
}

function value(of) {
  return of === null || of === undefined ? "–" : of.text ?? String(of.raw);
}
