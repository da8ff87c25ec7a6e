// Whether a drive is set to obey the bus; what is not can be set from here, by a button that is held.

import { h, text, words } from "./dom.js";
import { Hold } from "./hold.js";
import { wide } from "./setup_parts.js";
import * as session from "./session.js";

/** The part for the drive called `name`. */
export function verify(name) {
  const path = `/drives/${encodeURIComponent(name)}`;
  const seen = h("div", { class: "scroll", role: "status" });
  const look = async () => {
    text(seen, "Reading.");
    const { answer, error } = await session.set_up("GET", path);
    if (error !== null) text(seen, error);
    else seen.replaceChildren(...shown(answer, (addresses) => set(addresses)));
  };
  // The outcome of a write stays above what is read after it.
  const set = async (addresses) => {
    text(seen, "Setting.");
    const { answer, error, is_unknown } = await session.set_up("POST", path, { addresses });
    const is_good = answer?.outcome === "confirmed";
    const unknown = is_unknown ? " Whether the drive was set is unknown: below is what it has now." : "";
    const told = error === null ? `${words(answer.outcome)}: ${answer.message}` : `${error}${unknown}`;
    await look();
    seen.prepend(h("p", { class: is_good ? "message" : "wrong", role: "alert" }, told));
  };
  return h("section", { class: "part", "aria-label": name }, h("b", {}, name), wide("Verify", look), seen);
}

function shown({ right, identity, items }, set) {
  const wrong = items.filter(({ result, address }) => result === "wrong" && address !== null);
  const row = ({ what, text: sentence, found, wanted, result }) => h(
    "tr", { class: result === "wrong" ? "wrong" : null },
    h("td", { "data-label": "Setting" }, `${what}: ${sentence}`),
    h("td", { "data-label": "Now" }, value(found)),
    h("td", { "data-label": "Result" }, result === "right" ? "right" : `${words(result)}, must be ${wanted.map(value).join(" or ")}`),
  );
  const hold = new Hold(`Set ${wrong.length} on the drive`, "run", () => set(wrong.map(({ address }) => address)));
  const is_other = identity !== null && identity.result !== "right";
  return [
    h("p", {}, right ? "It is set to obey the bus." : "It is not known to obey the bus."),
    is_other && h("p", { class: "wrong" }, `Its identity is ${words(identity.result)}${identity.other ? `: ${identity.other}` : ""}.`),
    items.length > 0 && h("table", {}, h("tbody", {}, ...items.map(row))),
    wrong.length > 0 && h("p", { class: "message" }, "Setting writes to the drive. The motor must stand still."),
    wrong.length > 0 && hold.element,
  ].filter((part) => part !== false);
}

function value(of) {
  return of === null || of === undefined ? "–" : of.text ?? String(of.raw);
}
