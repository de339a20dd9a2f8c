"""Any commands at any time, cut anywhere: one at a time, one end each, and a stop always acts."""

from dataclasses import dataclass

from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.mops.codec import Message, encode
from tests.brick.rig import PERIOD_S, Rig, command, is_end
from tests.support.examples import examples

MOTIONS = {
    "moveForward": st.sampled_from([("0.1",), ("-0.05",), ("0.0",), ("1e9",)]),
    "rotateBy": st.sampled_from([("0.3",), ("-0.3",), ("x",)]),
    "rotateTo": st.sampled_from([("0.2",), ("-3.0",)]),
    "moveTo": st.sampled_from([("0.1", "0.0", "", ""), ("0.0", "0.05", "0.1", "")]),
    "drive": st.sampled_from([("0.1", "0.5", "0.8"), ("0.0", "0.0", "0.0"), ("9", "9", "9")]),
}
OTHERS = {
    "stop": st.just(()),
    "setTravelSpeed": st.sampled_from([("0.2",), ("7.0",)]),
    "setRotateSpeed": st.just(("1.0",)),
    "setCameraAngles": st.sampled_from([("0.5", ""), ("9.0", "-9.0")]),
    "moveCameraAngles": st.just(("0.1", "0.1")),
    "setCameraRotateSpeed": st.just(("0.4",)),
    "takePicture": st.just(("", "", "", "")),
    "resume": st.just(()),
}
NAMES = (*sorted(MOTIONS | OTHERS), *sorted(MOTIONS) * 2, *["stop"] * 8)
MAX_DURATION_S = 15.0


@dataclass(frozen=True)
class Act:
    """Wait, say a command up to a cut, wait, say the rest; garbage may go before."""

    name: str
    inputs: tuple[str, ...]
    wait: int
    cut: int
    pause: int
    garbage: bytes


@st.composite
def acts(draw: st.DrawFn) -> Act:
    name = draw(st.sampled_from(NAMES))
    few = st.integers(0, 4)
    return Act(
        name,
        draw((MOTIONS | OTHERS)[name]),
        draw(st.one_of(few, st.integers(5, 40))),
        draw(st.integers(0, 80)),
        draw(few),
        draw(st.sampled_from([b"", b"", b"\0\0\0", b"half|a|mess#", b"\xff\x00#"])),
    )


class Witness:
    """Plays acts, and checks each step of what the brick says."""

    def __init__(self, seed: int) -> None:
        self.rig = Rig(seed)
        self.requested: list[Message] = []
        self.ended: set[int] = set()
        self.octets: list[tuple[float, str]] = []
        self._seen = 0
        self._begun: int | None = None

    @property
    def open(self) -> set[int]:
        return {number(message) for message in self.requested} - self.ended

    @property
    def stops(self) -> set[int]:
        return {number(message) for message in self.requested if message.command == "STOP"}

    def play(self, act: Act) -> None:
        self.run(act.wait)
        message = command(act.name, len(self.requested) + 1, *act.inputs)
        octets = act.garbage + encode(message)
        self.rig.receive(octets[: act.cut])
        whole = act.cut >= len(octets)
        self.run(0 if whole else act.pause)
        before = self.open
        self.requested.append(message)
        self.rig.receive(octets[act.cut :])
        self.run(1)
        if act.name == "stop":
            assert not self.rig.turning
            assert self.open <= self.stops
            for stopped in before - self.stops:
                assert not self.rig.answers(self.requested[stopped - 1])[-1].message.executed
        elif before:
            answers = self.rig.answers(message)
            assert len(answers) == 1
            assert not answers[0].message.received

    def run(self, periods: int) -> None:
        for _ in range(periods):
            self.rig.step()
            self._poll()

    def finish(self) -> None:
        for _ in range(round(MAX_DURATION_S / PERIOD_S)):
            if not self.open:
                break
            self.run(1)
        self.run(10)
        assert self.open == set()
        assert not self.rig.turning

    def _poll(self) -> None:
        for received in self.rig.replies[self._seen :]:
            self._seen += 1
            reply = received.message
            self.octets.append((received.at_s, str(reply)))
            assert number(reply) in self.open, "one end each, and nothing after it"
            requested = self.requested[number(reply) - 1]
            assert (reply.code, reply.command) == (requested.code, requested.command)
            if not is_end(reply):
                assert self._begun is None, "one at a time"
                self._begun = number(reply)
                continue
            self.ended.add(number(reply))
            assert reply.executed or reply.command != "STOP"
            if self._begun == number(reply):
                self._begun = None


def number(message: Message) -> int:
    assert message.moe_inputs_id is not None
    return message.moe_inputs_id


@settings(max_examples=examples(300), deadline=None)
@given(st.lists(acts(), max_size=12), st.integers(0, 3))
def test_one_at_a_time_one_end_each_and_a_stop_always_acts(played: list[Act], seed: int) -> None:
    witness = Witness(seed)
    for act in played:
        witness.play(act)
    witness.finish()
