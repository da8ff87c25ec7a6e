// Signing in and out, and the stop for all.

import { add, announce, attribute, h, show, text } from "./dom.js";
import * as leases from "./leases.js";
import * as problems from "./problems.js";
import * as session from "./session.js";
import { t, words } from "./texts.js";
import { called } from "./titles.js";

/** Puts it into the page's head. */
export function start(place, form_place) {
  const stop = h("button", { type: "button", class: "stop all", click: stop_all }, t("action.stop_all"));
  const who = h("span", { class: "who" });
  const out = h("button", { type: "button", class: "plain", click: () => session.sign_out() }, t("sign.out"));
  const begin = h("button", { type: "button", class: "plain", "aria-expanded": "false", "aria-controls": "sign-in" }, t("sign.in"));
  const form = sign_in_form(() => {
    open(false);
    document.getElementById("main").focus();
  });
  const open = (is) => {
    show(form, is);
    begin.setAttribute("aria-expanded", String(is));
    if (is) form.elements.user.focus();
  };
  begin.addEventListener("click", () => open(form.hidden));
  form.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    open(false);
    begin.focus();
  });
  add(place, stop, who, out, begin);
  add(form_place, form);
  const draw = ({ enabled, user, role }) => {
    const is_in = user !== null;
    for (const element of [who, out]) show(element, is_in);
    show(stop, session.may_stop());
    show(begin, enabled && !is_in);
    if (is_in || !enabled) open_quietly(form, begin);
    if (!is_in) leases.end_all();
    text(who, user ?? "");
    attribute(who, "title", role === null ? null : words(role));
  };
  session.changed(draw);
  draw(session.current());
}

function open_quietly(form, begin) {
  show(form, false);
  begin.setAttribute("aria-expanded", "false");
}

function sign_in_form(done) {
  const message = h("p", { class: "wrong", role: "alert" });
  const submit = async (event) => {
    event.preventDefault();
    const { user, password, go } = form.elements;
    go.disabled = true;
    text(message, "");
    const wrong = await session.sign_in(user.value.trim(), password.value);
    go.disabled = false;
    password.value = "";
    text(message, wrong);
    if (wrong === null) done();
    else password.focus();
  };
  const form = h(
    "form",
    { id: "sign-in", class: "sign-in", hidden: true, "aria-label": t("sign.in"), submit },
    h("label", {}, `${t("sign.user")} `, h("input", { name: "user", autocomplete: "username", autocapitalize: "none", spellcheck: "false", required: true })),
    h("label", {}, `${t("sign.password")} `, h("input", { name: "password", type: "password", autocomplete: "current-password", required: true })),
    h("button", { name: "go", class: "primary" }, t("sign.in")),
    message,
  );
  return form;
}

async function stop_all() {
  problems.stopping();
  const begun = performance.now();
  const told = await session.stop_all();
  const { sentence, failed } = problems.stopped(told, performance.now() - begun);
  const names = failed.map(({ drive }) => called("drives", drive)).join(", ");
  announce(failed.length === 0 ? sentence : t("stop_all.failed", { sentence, names }), failed.length > 0);
}
