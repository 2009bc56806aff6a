"""The schema of the link between slave and master, and of the network put between them."""

from __future__ import annotations

import ipaddress
import re
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from teleop_rt.config.section import Section

Rate = Annotated[int, Field(ge=1, le=100_000)]
Second = Annotated[float, Field(ge=0, le=86_400)]
"""Of a trial, which lasts a day at most."""
_NAME = re.compile(r"[A-Za-z0-9_-]{1,63}(\.[A-Za-z0-9_-]{1,63})*\.?")
"""Of a machine, as the domain name system has it."""


class LinkConfig(Section):
    """The link between slave and master, and the network that is put between them."""

    host: str = Field("127.0.0.1", description="Address of the other side, by name or number.")
    bind_host: str = Field(
        "127.0.0.1",
        description="Address to listen on; loopback unless given, 0.0.0.0 for all interfaces.",
    )
    slave_port: int = Field(
        0,
        ge=0,
        le=65535,
        description=(
            "UDP port of the slave; 0 takes a free one in a run on one machine, sides started "
            "apart need a number."
        ),
    )
    master_port: int = Field(
        0, ge=0, le=65535, description="UDP port of the master; 0 takes a free one."
    )
    key_file: str | None = Field(
        None,
        description=(
            "File with the shared key of both sides, made by `teleop-rt keygen`; null makes a new "
            "key for a run on one machine."
        ),
    )
    accepted_rates_hz: tuple[Rate, Rate] = Field(
        (100, 4000),
        description="Lowest and highest loop rate of the other side; one outside gets no session.",
    )
    keep_alive_ms: float = Field(
        50,
        ge=1,
        le=1000,
        description=(
            "Longest time between two models that the slave sends, whether or not they changed."
        ),
    )
    model_deadband: Literal["noise", "just-noticeable", "none"] = Field(
        "noise",
        description=(
            "Change of force by a new model that is worth sending at once: above noise, just "
            "noticeable to a hand, or none (every tick)."
        ),
    )
    just_noticeable_share: float = Field(
        0.1,
        gt=0,
        lt=1,
        description=(
            "Smallest change of force that a hand can feel, as a share of the force; used by "
            "model_deadband just-noticeable."
        ),
    )
    round_trip_ms: float = Field(
        0,
        ge=0,
        le=10000,
        description="Delay added to the network, there and back; each direction gets half.",
    )
    one_way_max_ms: float | None = Field(
        None,
        gt=0,
        le=10_000,
        description=(
            "Longest delay of a message on its way before it counts as old; by default the link's"
            " delay when the axis was armed."
        ),
    )
    jitter_ms: float = Field(
        0,
        ge=0,
        le=1000,
        description=(
            "Width of the uniform jitter added to the round trip; each direction varies by plus or"
            " minus half of it."
        ),
    )
    loss: float = Field(
        0,
        ge=0,
        lt=1,
        description=(
            "Share of packets dropped in each direction, 0 to below 1; 0.01 is a poor network."
        ),
    )
    duplicate: float = Field(0, ge=0, lt=1, description="Share of packets delivered twice.")
    reorder: float = Field(
        0,
        ge=0,
        lt=1,
        description=(
            "Share of packets held back by another 5 ms, so that later ones overtake them."
        ),
    )
    loss_burst: float = Field(
        1,
        ge=1,
        le=1000,
        description="Mean number of packets lost in a row; 1 loses each packet independently.",
    )
    blackouts_s: tuple[tuple[Second, Second], ...] = Field(
        (),
        description=(
            "Intervals [start, end) without any packet, counted from the start of the trial."
        ),
    )

    @field_validator("host", "bind_host")
    @classmethod
    def _name_or_number(cls, host: str) -> str:
        """Refuse an address that no packet can have; a name is resolved at the start."""
        if ":" in host:
            raise ValueError(
                f"{host} is an IPv6 address or has a port, and the link uses IPv4 alone: give the"
                " IPv4 address or the name, and ports as slave_port and master_port"
            )
        if not _NAME.fullmatch(host):
            raise ValueError(
                f"{host!r} is no name of a machine: give its name of letters, digits, - and dots,"
                " or its IPv4 address"
            )
        if not host.replace(".", "").isdigit():
            return host
        try:
            number = ipaddress.IPv4Address(host)
        except ValueError as error:
            raise ValueError(f"{host} is no IPv4 address: give four numbers up to 255") from error
        if number.is_multicast or number == ipaddress.IPv4Address("255.255.255.255"):
            raise ValueError(f"{host} is the address of many machines: give that of one")
        return host

    @field_validator("host")
    @classmethod
    def _one_machine(cls, host: str) -> str:
        if host == "0.0.0.0":  # noqa: S104 - refused
            raise ValueError("0.0.0.0 is to listen on (bind_host): give the other side's address")
        return host

    @field_validator("blackouts_s")
    @classmethod
    def _end_after_start(
        cls, blackouts_s: tuple[tuple[Second, Second], ...]
    ) -> tuple[tuple[Second, Second], ...]:
        for start_s, end_s in blackouts_s:
            if end_s <= start_s:
                raise ValueError(
                    f"[{start_s:g}, {end_s:g}] does not end after its start, and no packet would"
                    " be lost: write [start, end] in seconds"
                )
        return blackouts_s

    @model_validator(mode="after")
    def _rates_in_order(self) -> LinkConfig:
        lowest, highest = self.accepted_rates_hz
        if lowest > highest:
            raise ValueError("accepted_rates_hz are two positive rates, the lowest first")
        return self
