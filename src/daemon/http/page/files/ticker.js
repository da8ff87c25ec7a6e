// A clock that goes on at its pace while the page is in the background, where a page's own timers are slowed down.

const timers = new Map();

self.onmessage = ({ data: { name, every_ms } }) => {
  clearInterval(timers.get(name));
  timers.delete(name);
  if (every_ms > 0) timers.set(name, setInterval(() => self.postMessage(name), every_ms));
};
