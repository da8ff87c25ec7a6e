// Notifications of the browser, for those who want them: each new problem, while the page is not looked at.

import { add, attribute, h, show } from "./dom.js";
import { keep, kept } from "./kept.js";
import { t } from "./texts.js";

const KEPT = "vfd-gateway-notify";
/** More at once are told in one. */
const SINGLE_MAX = 3;

let button = null;
let known = null;

/** Puts the switch into `element`. A browser notifies only on a page that came over TLS or from this host. */
export function start(element) {
  button = h("button", { type: "button", class: "link", click: choose }, t("notify.offer"));
  show(button, "Notification" in window && isSecureContext);
  add(element, button);
  draw();
}

function is_on() {
  return kept(KEPT) === "yes" && window.Notification?.permission === "granted";
}

async function choose() {
  const wanted = !is_on() && (await Notification.requestPermission()) === "granted";
  keep(KEPT, wanted ? "yes" : "no");
  draw();
}

function draw() {
  attribute(button, "aria-pressed", is_on());
  button.textContent = t(is_on() ? "notify.on" : "notify.offer");
  button.title = t("notify.what");
}

/** These are the problems now, each as one sentence. What was there when the page was opened is not told. */
export function problems(sentences) {
  const fresh = known === null ? [] : sentences.filter((sentence) => !known.has(sentence));
  known = new Set(sentences);
  if (fresh.length === 0 || !is_on() || document.hasFocus()) return;
  const told = fresh.length > SINGLE_MAX ? [t("notify.many", { count: fresh.length })] : fresh;
  for (const body of told) new Notification(document.title, { body, icon: "assets/icon-problem.svg", tag: body });
}
