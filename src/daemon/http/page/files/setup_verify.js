// Whether a drive is set to obey the bus; what is not can be set from here, by a button that is held.

import { h, text, words } from "./dom.js";
import { Hold } from "./hold.js";
import { wide } from "./setup_parts.js";

/** The part for the drive called `name`. */
export function verify(name, ask) {
  const path = `/drives/${encodeURIComponent(name)}`;
  const seen = h("div", { class: "scroll", role: "status" });
  const look = async () => {
    const document = await ask("GET", path);
    if (document) seen.replaceChildren(...shown(document, (addresses) => set(addresses)));
  };
  const set = async (addresses) => {
    text(seen, "Setting.");
    const { outcome, message } = (await ask("POST", path, { addresses })) ?? {};
    await look();
    if (outcome) seen.prepend(h("p", { class: outcome === "confirmed" ? "message" : "wrong" }, `${words(outcome)}: ${message}`));
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
