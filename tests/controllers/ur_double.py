"""A double of a UR controller: its RTDE protocol, and a robot program that is run as it is.

Written from UR's RTDE guide and script manual. Run as a process with its address; it ends with its
input. Once a robot program runs, a cycle ends when the client has sent its inputs, so nothing
depends on time; with `paced` a cycle also takes 2 ms. URScript's `end` and Python's indentation
make programs of this kind Python, so the double executes the text that it gets.

Words such as `safety_mode=3` set a variable, `used=input_int_register_24` is another client's, and
`stopped_at=100` makes a protective stop in cycle 100 of a motion, from cycle `slowed_at=100` on the
speed slider is at 50 %, and from cycle `missing_at=100` on the program gets no inputs. With
`gain=500` or `lookahead=0.05`, `servoj` must have these arguments instead of UR's defaults.
"""

from __future__ import annotations

import select
import socket
import struct
import sys
import threading

CYCLE = 2e-3
NAMES = ("robot_mode", "safety_mode", "runtime_state")
TYPES = {"timestamp": "DOUBLE", "target_q": "VECTOR6D", "actual_q": "VECTOR6D"}
TYPES |= {"runtime_state": "UINT32", "robot_mode": "INT32", "safety_mode": "INT32"}
TYPES |= {"target_speed_fraction": "DOUBLE"}
TYPES |= {f"{x}_int_register_{i}": "INT32" for x in ("input", "output") for i in range(48)}
TYPES |= {f"{x}_double_register_{i}": "DOUBLE" for x in ("input", "output") for i in range(48)}
FORMATS = {"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i", "UINT32": "I"}
START = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)
# Share of the distance to the set-point that the simulated joints move in a cycle.
GAIN = 0.1


class ProgramEnd(Exception):
    """The client has gone, or the program has run too long without inputs."""


class Double:
    """The controller's variables, and its cycle."""

    def __init__(self, address: str, state: dict[str, float], used: str, *, paced: bool) -> None:
        self.paced = paced
        self.used = used
        self.stopped_at = state.pop("stopped_at", float("inf"))
        self.slowed_at = state.pop("slowed_at", float("inf"))
        self.missing_at = state.pop("missing_at", float("inf"))
        self.servo = (state.pop("lookahead", 0.1), state.pop("gain", 300.0))
        self.values: dict[str, float] = dict.fromkeys(TYPES, 0)
        self.values |= {"robot_mode": 7, "safety_mode": 1, "runtime_state": 1}
        self.values |= {"target_speed_fraction": 1.0, **state}
        self.target = list(START)
        self.actual = list(START)
        self.cycles = 0
        self.rtde = socket.create_server((address, 30004))
        self.script = socket.create_server((address, 30002))
        self.received = b""

    def serve(self) -> None:
        """Serve one client after the other."""
        while True:
            self.client, _ = self.rtde.accept()
            self.received = b""
            self.outputs = []
            self.inputs = []
            self.values["runtime_state"] = 1
            self.started = False
            try:
                while True:
                    self.idle()
            except ProgramEnd:
                self.client.close()

    def idle(self) -> None:
        """Answer requests, send the state, and run a program that arrives."""
        readable, _, _ = select.select(
            [self.client, self.script], [], [], CYCLE if self.started else None
        )
        if self.client in readable:
            self.obey()
        if self.script in readable:
            connection, _ = self.script.accept()
            text = b"".join(iter(lambda: connection.recv(4096), b"")).decode()
            connection.close()
            self.run_program(text)
        if self.started:
            self.cycle()

    def run_program(self, text: str) -> None:
        """Execute a robot program until its end."""
        print("program", flush=True)
        lines = [x for x in text.splitlines() if x.strip() != "end"]
        (name,) = [x[4:-3] for x in lines if x.startswith("def ")]
        self.values["runtime_state"] = 2
        scope = {
            "get_target_joint_positions": lambda: list(self.target),
            "rtde_set_watchdog": lambda name, frequency, action: None,
            "read_input_integer_register": lambda i: self.values[f"input_int_register_{i}"],
            "read_input_float_register": lambda i: self.values[f"input_double_register_{i}"],
            "write_output_integer_register": self.setter("output_int_register_{}"),
            "write_output_float_register": self.setter("output_double_register_{}"),
            "servoj": self.servoj,
            "stopj": lambda a: None,
        }
        exec("\n".join(lines), scope)
        scope[name]()
        self.values["runtime_state"] = 1

    def setter(self, name: str):
        """A function that sets a register."""

        def set_register(i: int, value: float) -> None:
            self.values[name.format(i)] = value

        return set_register

    def servoj(self, q, a, v, t, lookahead, gain) -> None:
        """Move to a row in one cycle, or more if the speed is scaled.

        After each cycle, send the state and wait for inputs. UR's article "Trajectory improvements
        for servoj()" states the number of cycles: at 50 %, a `servoj` of 2 ms takes 4 ms.
        """
        assert (t, (lookahead, gain)) == (CYCLE, self.servo)
        if self.values["output_int_register_24"] >= self.slowed_at:
            self.values["target_speed_fraction"] = 0.5
        self.target = list(q)
        for _ in range(round(1 / self.values["target_speed_fraction"])):
            self.cycle()
            if self.paced:
                select.select([], [], [], CYCLE)
            while self.values["output_int_register_24"] < self.missing_at and self.obey() != "U":
                pass

    def cycle(self) -> None:
        """One cycle of the joints and of the outputs."""
        self.actual = [x + GAIN * (y - x) for x, y in zip(self.actual, self.target, strict=True)]
        self.cycles += 1
        if self.values["output_int_register_24"] >= self.stopped_at:
            self.values |= {"safety_mode": 3, "runtime_state": 1}
        values = [1]
        for name in self.outputs:
            if name in ("target_q", "actual_q"):
                values += self.target if name == "target_q" else self.actual
            else:
                values.append(self.cycles * CYCLE if name == "timestamp" else self.values[name])
        kinds = "".join(FORMATS[TYPES[x]] for x in self.outputs)
        self.send("U", struct.pack(">B" + kinds, *values))

    def obey(self) -> str:
        """Obey one package of the client."""
        while len(self.received) < 3 or len(self.received) < int.from_bytes(self.received[:2]):
            try:
                data = self.client.recv(1 << 16)
            except OSError:
                data = b""
            if not data:
                raise ProgramEnd
            self.received += data
        size, kind = struct.unpack_from(">HB", self.received)
        data = self.received[3:size]
        self.received = self.received[size:]
        kind = chr(kind)
        if kind == "V":
            self.send("V", b"\x01" if data == b"\x00\x02" else b"\x00")
        elif kind == "O":
            self.outputs = data[8:].decode().split(",")
            assert struct.unpack(">d", data[:8]) == (1 / CYCLE,)
            self.send("O", b"\x01" + self.types(self.outputs))
        elif kind == "I":
            self.inputs = data.decode().split(",")
            self.send("I", b"\x07" + self.types(self.inputs))
        elif kind == "S":
            self.started = True
            self.send("S", b"\x01")
        elif kind == "U":
            kinds = "".join(FORMATS[TYPES[x]] for x in self.inputs)
            recipe, *values = struct.unpack(">B" + kinds, data)
            assert recipe == 7
            self.values |= dict(zip(self.inputs, values, strict=True))
        return kind

    def types(self, names: list[str]) -> bytes:
        """The types of variables, as the controller names them."""
        kinds = ("IN_USE" if x == self.used else TYPES.get(x, "NOT_FOUND") for x in names)
        return ",".join(kinds).encode()

    def send(self, kind: str, data: bytes) -> None:
        """Send a package."""
        try:
            self.client.sendall(struct.pack(">HB", len(data) + 3, ord(kind)) + data)
        except OSError:
            raise ProgramEnd from None


if __name__ == "__main__":
    address, *words = sys.argv[1:]
    given = dict(x.split("=") for x in words if "=" in x)
    used = given.pop("used", "")
    state = {x: int(y) if x in NAMES else float(y) for x, y in given.items()}
    double = Double(address, state, used, paced="paced" in words)
    threading.Thread(target=double.serve, daemon=True).start()
    print("listening", flush=True)
    # The double ends when its input is closed.
    sys.stdin.read()
