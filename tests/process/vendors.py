"""Plays a drive that turns a motor on a serial port or a TCP port, with somebody else's Modbus server.

    vendors.py e510|fr500a PORT STATION

PORT is a device, or `tcp:NUMBER` for Modbus TCP on this machine.

Registers, bits, limits and exceptions are typed from the vendors' documents. Whatever the drive hears and refuses is
printed, one JSON object per line. `trip CODE` on stdin trips it; the end of stdin ends it.
"""

import asyncio
import json
import sys
import time

from pymodbus import FramerType
from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

READ, WRITE, LOOP_TEST, WRITE_BLOCK = 0x03, 0x06, 0x08, 0x10


class Motor:
    """Follows a signed target in 0.01 Hz at 20 Hz/s, as long as its drive lets it."""

    STEPS_PER_S = 2000

    def __init__(self):
        self.output, self.target, self.at = 0.0, 0, time.monotonic()

    def turn(self):
        now = time.monotonic()
        most, self.at = (now - self.at) * self.STEPS_PER_S, now
        self.output += max(-most, min(most, self.target - self.output))
        return round(self.output)

    def cut_off(self):
        self.output, self.target = 0.0, 0


class Drive:
    """What both have in common: a map of words and a motor."""

    def __init__(self, words):
        self.words, self.motor, self.trip = dict(words), Motor(), 0

    def simdata(self):
        return [SimData(address, values=word, datatype=DataType.REGISTERS) for address, word in self.words.items()]

    async def access(self, function, start, address, count, registers, values):
        """What pymodbus asks before it reads or writes; what it reads is in `registers`, from `start`."""
        if function not in self.FUNCTIONS:
            return ExcCodes.ILLEGAL_FUNCTION
        if count > self.MOST[function]:
            return ExcCodes.ILLEGAL_VALUE
        if function == READ:
            if any(it in self.WRITE_ONLY for it in range(address, address + count)):
                return ExcCodes.ILLEGAL_ADDRESS
            self.show(self.motor.turn())
            for it, word in self.words.items():
                registers[it - start] = word & 0xFFFF
            return None
        for it, word in zip(range(address, address + count), values or []):
            if it not in self.WRITABLE:
                return ExcCodes.ILLEGAL_ADDRESS
            self.words[it] = word
        # pymodbus reads back what 06 has written, with the same function.
        if values:
            self.motor.turn()
            self.written(range(address, address + count))
        return None


class E510(Drive):
    """TECO E510 set to ASCII, and else as it leaves the works; a pseudo-terminal cannot be set to 7 bits."""

    LINE = {"framer": FramerType.ASCII, "baudrate": 19200, "bytesize": 8, "parity": "N", "stopbits": 1}
    FUNCTIONS = {READ, WRITE, LOOP_TEST, WRITE_BLOCK}
    # Words in one frame of at most 80 characters.
    MOST = {READ: 17, WRITE: 1, WRITE_BLOCK: 15}
    # 51 function code, 52 register address, 53 amount of data.
    EXCEPTIONS = {1: 0x51, 2: 0x52, 3: 0x53}
    COMMAND, FREQUENCY = 0x2501, 0x2502
    WRITABLE = WRITE_ONLY = {COMMAND, FREQUENCY}
    RUN, REVERSE, RESET = 1, 2, 8

    def __init__(self):
        super().__init__(
            {
                0x0002: 2,  # 00-02 run source: communication
                0x0005: 5,  # 00-05 frequency source: communication
                0x0906: 0,  # 09-06 loss detection off
                0x0907: 0,  # 09-07 reaction to a loss
                0x0D00: 510,  # 13-00 model
                0x0D01: 11,  # 13-01 software version
                self.COMMAND: 0,
                self.FREQUENCY: 0,
                **{it: 0 for it in range(0x2520, 0x2528)},
                # What stands here is not documented well: each word is its own address.
                **{it: it for it in range(0x2528, 0x2533)},
            }
        )
        self.resets = False

    def written(self, addresses):
        command = self.words[self.COMMAND]
        is_reset = bool(command & self.RESET)
        if is_reset and not self.resets:
            self.trip = 0
        self.resets = is_reset
        runs = command & self.RUN and not self.trip
        sign = -1 if command & self.REVERSE else 1
        self.motor.target = sign * self.words[self.FREQUENCY] if runs else 0

    def show(self, output):
        turns = output != 0 or self.motor.target != 0
        status = (turns << 0) | ((output < 0) << 1) | ((not self.trip) << 2) | (bool(self.trip) << 3)
        speed = abs(output)
        self.words |= {
            0x2520: status,
            0x2521: self.trip,
            0x2523: self.words[self.FREQUENCY],  # 0.01 Hz
            0x2524: speed,  # 0.01 Hz
            0x2525: speed * 400 // 500,  # 0.1 V, 400 V at 50 Hz
            0x2526: 565,  # V
            0x2527: 52 if turns else 0,  # 0.1 A
        }

    def trips(self, code):
        self.trip, self.words[self.COMMAND] = code, 0
        self.motor.cut_off()


class Fr500a(Drive):
    """Frecon FR500A with the communication format of its parameter table."""

    LINE = {"framer": FramerType.RTU, "baudrate": 9600, "bytesize": 8, "parity": "N", "stopbits": 2}
    FUNCTIONS = {READ, WRITE, LOOP_TEST}
    MOST = {READ: 8, WRITE: 1}
    EXCEPTIONS = {1: 1, 2: 2, 3: 3}
    COMMAND, FREQUENCY = 0x2000, 0x2001
    WRITABLE = WRITE_ONLY = {COMMAND, FREQUENCY}
    FORWARD, REVERSE, JOG_FORWARD, JOG_REVERSE, STOP, COAST, RESET = range(1, 8)
    # States of 2100H.
    AT_REST, RUNNING, JOGGING, PARKING, FAULT = 0, 1, 2, 4, 6

    def __init__(self):
        super().__init__(
            {
                0x0014: 55,  # F00.20 power, 0.1 kW
                0x0015: 400,  # F00.21 voltage
                0x0016: 130,  # F00.22 current, 0.1 A
                0x0017: 214,  # F00.23 software version
                0x0101: 3,  # F01.01 master frequency: communication
                0x0200: 2,  # F02.00 run command: communication
                0x0B0B: 0,  # F11.11 reaction to faults
                0x0F03: 0,  # F15.03 communication time-out off
                self.COMMAND: 0,
                self.FREQUENCY: 0,
                0x2100: 0,
                0x2101: 0,
                **{it: 0 for it in range(0x3000, 0x3027)},
                **{it: 0 for it in range(0x3100, 0x311A)},
            }
        )
        self.runs, self.jogs = 0, False

    def written(self, addresses):
        if self.COMMAND in addresses:
            self.obey(self.words[self.COMMAND])
        # Jogging has a frequency of its own, 5.00 Hz here.
        self.motor.target = self.runs * (500 if self.jogs else self.words[self.FREQUENCY])

    def obey(self, command):
        if command == self.RESET:
            self.trip = 0
        elif self.trip or command in (self.STOP, self.COAST):
            self.runs = 0
            if command == self.COAST:
                self.motor.cut_off()
        elif self.FORWARD <= command <= self.JOG_REVERSE:
            self.runs = 1 if command in (self.FORWARD, self.JOG_FORWARD) else -1
            self.jogs = command in (self.JOG_FORWARD, self.JOG_REVERSE)

    def show(self, output):
        state = self.AT_REST
        if self.trip:
            state = self.FAULT
        elif self.runs:
            state = self.JOGGING if self.jogs else self.RUNNING
        elif output:
            state = self.PARKING
        speed = abs(output)
        self.words |= {
            0x2100: state,
            0x2101: ((output < 0) << 1) | (2 << 2),  # commanded by communication
            0x3000: speed,  # U00.00, 0.01 Hz
            0x3001: self.words[self.FREQUENCY],  # U00.01, 0.01 Hz
            0x3002: speed * 400 // 500,  # U00.02, 0.1 V
            0x3003: 52 if output else 0,  # U00.03, 0.1 A
            0x3004: speed // 200,  # U00.04, 0.1 kW
            0x3005: speed * 60 // 200,  # U00.05, four poles
            0x3006: 565,  # U00.06, V
            0x3007: speed,  # U00.07, 0.01 Hz
            0x3017: -35,  # U00.23, 0.1 degC, signed
            0x301B: 1234,  # U00.27, h
            0x301F: 401 if output else 0,  # U00.31, 0.1 %
        }

    def trips(self, code):
        # The newest record: code, 0.01 Hz, 0.1 A, V, h.
        for at, word in enumerate([code, abs(self.motor.turn()), 99, 612, 1234]):
            self.words[0x3100 + at] = word
        self.trip, self.runs = code, 0
        self.motor.cut_off()


def tell(what, pdu, **more):
    print(json.dumps({what: pdu.function_code & 0x7F, "station": pdu.dev_id, **more}), flush=True)


def tracer(drive):
    def trace(is_reply, pdu):
        if isinstance(pdu, ExceptionResponse):
            pdu.exception_code = drive.EXCEPTIONS[int(pdu.exception_code)]
            tell("refused", pdu, exception=pdu.exception_code)
        elif not is_reply and pdu.function_code == LOOP_TEST:
            tell("heard", pdu, address=pdu.sub_function_code, words=[int.from_bytes(pdu.message, "big")])
        elif not is_reply and pdu.function_code == READ:
            tell("heard", pdu, address=pdu.address, count=pdu.count)
        elif not is_reply:
            tell("heard", pdu, address=pdu.address, words=list(pdu.registers))
        return pdu

    return trace


def typed(drive, ended):
    words = sys.stdin.readline().split()
    if words[:1] == ["trip"]:
        drive.trips(int(words[1]))
    elif not words:
        ended.set()


async def main():
    drive = {"e510": E510, "fr500a": Fr500a}[sys.argv[1]]()
    device = SimDevice(id=int(sys.argv[3]), simdata=drive.simdata(), action=drive.access)
    port = sys.argv[2]
    if port.startswith("tcp:"):
        address = ("127.0.0.1", int(port.removeprefix("tcp:")))
        server = ModbusTcpServer(device, address=address, trace_pdu=tracer(drive))
    else:
        server = ModbusSerialServer(device, port=port, trace_pdu=tracer(drive), **drive.LINE)
    ended = asyncio.Event()
    asyncio.get_running_loop().add_reader(sys.stdin, typed, drive, ended)
    await server.serve_forever(background=True)
    print(json.dumps({"plays": sys.argv[1]}), flush=True)
    await ended.wait()
    await server.shutdown()


asyncio.run(main())
