// Says to a person who starts the installed app that the gateway cannot be reached. It keeps one page and answers nothing else.

// A browser keeps the page until this name is another one: a changed page needs a new name.
const KEPT = "offline-2";
const PAGE = "assets/offline.html";

self.addEventListener("install", (event) => event.waitUntil(caches.open(KEPT).then((kept) => kept.add(PAGE))));

self.addEventListener("fetch", (event) => {
  if (event.request.mode !== "navigate") return;
  event.respondWith(fetch(event.request).catch(async () => (await caches.match(PAGE)) ?? Response.error()));
});
