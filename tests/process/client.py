"""Plays an ordinary Modbus TCP client and prints what it got, one JSON object per line.

    client.py PORT [--tls DIRECTORY NAME SOURCE] REQUEST...
    client.py DEVICE [--ascii] REQUEST...

With `--tls` it comes from the address SOURCE with the certificate NAME.pem, whose key is NAME.key, and trusts ca.pem.
With a serial DEVICE it is a master at 9600 8N1, in RTU unless `--ascii` is given.
One request `-` takes requests line by line from its input.

A request is `read:UNIT:ADDRESS:COUNT`, with `read_input`, `coils` or `discrete` for the other tables,
`write:UNIT:ADDRESS:VALUE[,VALUE]`, `coil:UNIT:ADDRESS:0|1`, `flags:UNIT:ADDRESS:0|1[,0|1]` (function 0F),
`mask:UNIT:ADDRESS:AND,OR`, `both:UNIT:ADDRESS:COUNT,WRITE_ADDRESS,VALUE[,VALUE]` (function 17 hex),
`identity:UNIT:ACCESS:OBJECT` or `loop:UNIT:0:WORD`.
"""

import json
import ssl
import sys

from pymodbus import FramerType, ModbusException
from pymodbus.client import ModbusSerialClient, ModbusTcpClient, ModbusTlsClient


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
    values = [int(value, 0) for value in rest.split(",")]
    if verb == "flags":
        return client.write_coils(address, [value == 1 for value in values], device_id=unit)
    if verb == "mask":
        and_mask, or_mask = values
        return client.mask_write_register(address=address, and_mask=and_mask, or_mask=or_mask, device_id=unit)
    if verb == "both":
        count, write_address, *words = values
        return client.readwrite_registers(
            read_address=address, read_count=count, write_address=write_address, values=words, device_id=unit
        )
    if verb == "identity":
        return client.read_device_information(read_code=address, object_id=values[0], device_id=unit)
    if verb == "write":
        if len(values) == 1:
            return client.write_register(address, values[0], device_id=unit)
        return client.write_registers(address, values, device_id=unit)
    raise SystemExit(f"no such request: {request}")


def connect(port, args):
    # No repeats: a test wants to see the first answer, whatever it is.
    options = {"timeout": 6, "retries": 0}
    if port.startswith("/"):
        is_ascii = args[:1] == ["--ascii"]
        framer = FramerType.ASCII if is_ascii else FramerType.RTU
        client = ModbusSerialClient(port, framer=framer, baudrate=9600, timeout=4, retries=0)
        return client, args[is_ascii:]
    options["port"] = int(port)
    if args[:1] != ["--tls"]:
        return ModbusTcpClient("127.0.0.1", **options), args
    _, directory, name, source, *requests = args
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    # The library does not say to TLS what the host is called; whose certificate it is, is verified all the same.
    context.check_hostname = False
    context.load_verify_locations(f"{directory}/ca.pem")
    context.load_cert_chain(f"{directory}/{name}.pem", f"{directory}/{name}.key")
    return ModbusTlsClient("127.0.0.1", sslctx=context, source_address=(source, 0), **options), requests


def main():
    client, requests = connect(sys.argv[1], sys.argv[2:])
    if not client.connect():
        raise SystemExit("cannot connect")
    for request in (line.strip() for line in sys.stdin) if requests == ["-"] else requests:
        try:
            answer = ask(client, request)
        except ModbusException:
            if not sys.argv[1].startswith("/"):
                raise
            print(json.dumps({"silent": True}), flush=True)
            continue
        if answer.isError():
            told = {"exception": answer.exception_code}
        elif request.startswith("flags") or (request.startswith("write") and "," in request):
            told = {"count": answer.count}
        elif request.startswith("mask"):
            told = {"masks": [answer.and_mask, answer.or_mask]}
        elif request.startswith("identity"):
            told = {"identity": {str(at): text.decode() for at, text in answer.information.items()}}
        elif request.startswith(("coil", "discrete")):
            # The library fills the last byte up.
            count = int(request.split(":")[3]) if not request.startswith("coil:") else 1
            told = {"bits": list(answer.bits)[:count]}
        elif request.startswith("loop"):
            told = {"words": [int.from_bytes(answer.message, "big")]}
        else:
            told = {"words": list(answer.registers)}
        print(json.dumps(told), flush=True)
    client.close()


main()
