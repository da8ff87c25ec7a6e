// The command line of both clients here: requests in, one JSON object per line out.
//
//     NAME.js PORT REQUEST...
//
// A request is one of `client.py`, and besides
//
//     together:REQUEST|REQUEST...   sends all without waiting, and prints their answers as a list, in order
//     again                         closes the connection and opens another one

export function parse(request) {
  const [verb, unit, address, rest] = request.split(':');
  return { verb, unit: Number(unit), address: Number(address), values: rest.split(',').map(Number) };
}

export async function main(ask, again) {
  for (const request of process.argv.slice(3)) {
    if (request === 'again') {
      await again();
      continue;
    }
    const together = request.startsWith('together:') && request.slice('together:'.length).split('|');
    const answer = together ? await Promise.all(together.map((it) => ask(parse(it)))) : await ask(parse(request));
    console.log(JSON.stringify(answer));
  }
}

export const port = Number(process.argv[2]);
