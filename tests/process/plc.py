"""Plays a controller that runs a function block in structured text beside a Modbus TCP client, in a cycle of 100 ms.

    plc.py FILE HOST PORT UNIT

FILE has one function block with the inputs Image and LinkOk and the outputs Command and WriteEnable: words 0 to 26 are read
into Image, then the block is called, then Command is written to 256 and 257 if WriteEnable is TRUE. Other inputs are set by
lines of JSON, such as {"Start": true}; {"lost": 3} lets the next three reads go unanswered, and Image is 0 meanwhile. All
outputs are printed as JSON when one of them has changed.
"""

import json
import sys
import threading
import time
from dataclasses import dataclass, field

from blark import parse
from blark import transform as st
from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

CYCLE_S = 0.1
WORDS = 27
DEFAULTS = {"BOOL": False, "REAL": 0.0, "TIME": 0.0}


@dataclass
class RisingEdge:
    CLK: bool = False
    Q: bool = False
    before: bool = False

    def call(self):
        self.Q, self.before = self.CLK and not self.before, self.CLK


@dataclass
class OnDelay:
    IN: bool = False
    PT: float = 0.0
    Q: bool = False
    since: float | None = None

    def call(self):
        if not self.IN:
            self.since, self.Q = None, False
            return
        self.since = time.monotonic() if self.since is None else self.since
        self.Q = time.monotonic() - self.since >= self.PT


BLOCKS = {"R_TRIG": RisingEdge, "TON": OnDelay}


def converted(name, value):
    """The conversions of IEC 61131-3, named FROM_TO_INTO, for values that fit."""
    into = name.split("_TO_")[1]
    if into == "REAL":
        return float(value)
    whole = round(value)
    low, high = {"DINT": (-(2**31), 2**31 - 1)}.get(into, (0, 65535))
    if not low <= whole <= high:
        raise ValueError(f"{name}({value}) does not fit")
    return whole


OPERATORS = {
    "AND": lambda a, b: a & b,
    "OR": lambda a, b: a | b,
    "=": lambda a, b: a == b,
    "<>": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    ">": lambda a, b: a > b,
    "<=": lambda a, b: a <= b,
    ">=": lambda a, b: a >= b,
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
}


@dataclass
class Block:
    variables: dict = field(default_factory=dict)
    outputs: list = field(default_factory=list)
    statements: list = field(default_factory=list)

    @classmethod
    def read(cls, path):
        with open(path, encoding="utf-8") as file:
            (source,) = parse.parse_source_code(file.read()).transform().items
        block = cls(statements=source.body.statements)
        for group in source.declarations:
            for item in group.items:
                for declared in item.variables:
                    name = str(declared.variable.name)
                    block.variables[name] = block.initial(item.init)
                    if isinstance(group, st.OutputDeclarations):
                        block.outputs.append(name)
        return block

    def initial(self, init):
        if isinstance(init, st.ArrayTypeInitialization):
            (bounds,) = init.spec.subranges
            return [0] * (self.value(bounds.stop) + 1)
        kind = str(init.spec.type)
        if kind in BLOCKS:
            return BLOCKS[kind]()
        return DEFAULTS.get(kind, 0) if init.value is None else self.value(init.value)

    def run(self):
        self.carry_out(self.statements)

    def carry_out(self, statements):
        for statement in statements:
            match statement:
                case st.AssignmentStatement(variables=variables, expression=expression):
                    value = self.value(expression)
                    for variable in variables:
                        self.assign(variable, value)
                case st.IfStatement():
                    self.carry_out(self.chosen(statement))
                case st.FunctionCallStatement(name=name, parameters=parameters):
                    called = self.variables[str(name.name)]
                    for parameter in parameters:
                        setattr(called, str(parameter.name.name), self.value(parameter.value))
                    called.call()
                case _:
                    raise NotImplementedError(type(statement).__name__)

    def chosen(self, statement):
        for branch in [statement, *statement.else_ifs]:
            if self.value(branch.if_expression):
                return branch.statements.statements
        return statement.else_clause.statements.statements if statement.else_clause else []

    def assign(self, target, value):
        if isinstance(target, st.SimpleVariable):
            if str(target.name) not in self.variables:
                raise NameError(str(target.name))
            self.variables[str(target.name)] = value
        else:
            (element,) = target.elements
            self.variables[str(target.name.name)][self.value(element.subscripts[0])] = value

    def value(self, it):
        match it:
            case st.SimpleVariable(name=name):
                return self.variables[str(name)]
            case st.MultiElementVariable(name=name, elements=[element]):
                whole = self.variables[str(name.name)]
                if isinstance(element, st.FieldSelector):
                    return getattr(whole, str(element.field.name))
                return whole[self.value(element.subscripts[0])]
            case st.ParenthesizedExpression(expr=expr):
                return self.value(expr)
            case st.BinaryOperation(left=left, op=op, right=right):
                return OPERATORS[str(op)](self.value(left), self.value(right))
            case st.UnaryOperation(op=op, expr=expr) if str(op) == "NOT":
                return not self.value(expr)
            case st.FunctionCall(name=name, parameters=[parameter]):
                return converted(str(name.name), self.value(parameter.value))
            case st.Boolean(value=value):
                return str(value).upper() == "TRUE"
            case st.HexInteger(value=value):
                return int(value, 16)
            case st.Integer(value=value):
                return int(value)
            case st.Real(value=value):
                return float(value)
            case st.Duration(seconds=seconds):
                return float(seconds)
            case _:
                raise NotImplementedError(type(it).__name__)


def listen(inputs):
    for line in sys.stdin:
        inputs.append(json.loads(line))


def answered(ask):
    try:
        answer = ask()
    except ModbusException:
        return None
    return None if answer.isError() else answer


def main(path, host, port, unit):
    block, inputs, told, lost = Block.read(path), [], None, 0
    threading.Thread(target=listen, args=(inputs,), daemon=True).start()
    client = ModbusTcpClient(host, port=int(port), timeout=2)
    while True:
        begun = time.monotonic()
        # One line a cycle: a button that is pressed is seen.
        if inputs:
            line = inputs.pop(0)
            lost = line.pop("lost", lost)
            for name, value in line.items():
                if name not in block.variables:
                    raise NameError(name)
                block.variables[name] = value
        image = None
        if lost:
            # Some clients keep what they had, others show this.
            lost, block.variables["Image"] = lost - 1, [0] * WORDS
        else:
            image = answered(lambda: client.read_holding_registers(0, count=WORDS, device_id=int(unit)))
        block.variables["LinkOk"] = image is not None
        if image is not None:
            block.variables["Image"] = image.registers
        block.run()
        if block.variables["WriteEnable"]:
            answered(lambda: client.write_registers(256, block.variables["Command"], device_id=int(unit)))
        outputs = {name: block.variables[name] for name in block.outputs}
        if outputs != told:
            told = json.loads(json.dumps(outputs))
            print(json.dumps(outputs), flush=True)
        time.sleep(max(0.0, CYCLE_S - (time.monotonic() - begun)))


if __name__ == "__main__":
    main(*sys.argv[1:])
