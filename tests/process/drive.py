"""Plays a drive on a serial port with somebody else's Modbus RTU server.

    drive.py PORT STATION

Every register of the groups D and F (0x0100 to 0x02FF) holds its own address, so that a reader sees at once
whether it got the register that it asked for.
"""

import sys

from pymodbus import FramerType
from pymodbus.server import StartSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice

FIRST, LAST = 0x0100, 0x02FF


def main():
    port, station = sys.argv[1], int(sys.argv[2])
    block = SimData(FIRST, values=list(range(FIRST, LAST + 1)), datatype=DataType.REGISTERS)
    StartSerialServer(
        SimDevice(id=station, simdata=[block]),
        framer=FramerType.RTU,
        port=port,
        baudrate=9600,
        bytesize=8,
        parity="N",
        stopbits=1,
    )


main()
