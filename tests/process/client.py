"""Plays an ordinary Modbus TCP client and prints what it got, one JSON object per line.

    client.py PORT REQUEST...

A request is `read:UNIT:ADDRESS:COUNT`, with `read_input`, `coils` or `discrete` for the other tables,
`write:UNIT:ADDRESS:VALUE[,VALUE]`, `coil:UNIT:ADDRESS:0|1` or `loop:UNIT:0:WORD`.
"""

import json
import sys

from pymodbus.client import ModbusTcpClient


def ask(client, request):
    verb, unit, address, rest = request.split(":")
    unit, address = int(unit), int(address, 0)
    if verb == "read":
        return client.read_holding_registers(address, count=int(rest), device_id=unit)
    if verb == "read_input":
        return client.read_input_registers(address, count=int(rest), device_id=unit)
    if verb == "coils":
        return client.read_coils(address, count=int(rest), device_id=unit)
    if verb == "discrete":
        return client.read_discrete_inputs(address, count=int(rest), device_id=unit)
    if verb == "coil":
        return client.write_coil(address, rest == "1", device_id=unit)
    if verb == "loop":
        return client.diag_query_data(int(rest, 0).to_bytes(2, "big"), device_id=unit)
    if verb == "write":
        values = [int(value) for value in rest.split(",")]
        if len(values) == 1:
            return client.write_register(address, values[0], device_id=unit)
        return client.write_registers(address, values, device_id=unit)
    raise SystemExit(f"no such request: {request}")


def main():
    # No repeats: a test wants to see the first answer, whatever it is.
    client = ModbusTcpClient("127.0.0.1", port=int(sys.argv[1]), timeout=6, retries=0)
    if not client.connect():
        raise SystemExit("cannot connect")
    for request in sys.argv[2:]:
        answer = ask(client, request)
        if answer.isError():
            print(json.dumps({"exception": answer.exception_code}))
        elif request.startswith(("coil", "discrete")):
            # The library fills the last byte up.
            count = int(request.split(":")[3]) if not request.startswith("coil:") else 1
            print(json.dumps({"bits": list(answer.bits)[:count]}))
        elif request.startswith("loop"):
            print(json.dumps({"words": [int.from_bytes(answer.message, "big")]}))
        else:
            print(json.dumps({"words": list(answer.registers)}))
    client.close()


main()
