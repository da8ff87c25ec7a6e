// Titles: what people call the gateway, its lines, drives and groups. Names stay for addresses and commands.

let titles = {};

/** These are the titles now. */
export function take(now) {
  titles = now ?? {};
}

/** A title isolated from the direction of the text around it, or the name where there is none. */
export function shown(title, name) {
  return title ? `\u2068${title}\u2069` : name;
}

/** What people are shown for the part called `name`; `kind` is `drives`, `lines` or `groups`. */
export function called(kind, name) {
  const known = titles[kind] ?? {};
  return shown(Object.hasOwn(known, name) ? known[name] : null, name);
}

/** What people are shown for the gateway. */
export function gateway(name) {
  return shown(titles.gateway, name);
}
