"""Bundle Protocol version 7 (RFC 9171): an agent with a durable store; knows nothing of rovers."""

from adapters.bundle.agent import BundleAgent, Delivery, Health, NeighbourHealth
from adapters.bundle.agent_settings import AgentSettings, Peer, listen_error, make_agent
from adapters.bundle.codec.bundle import DTN_EPOCH_UTC_MS, BundleId
from adapters.bundle.codec.eid import Eid, Ipn, node_of, parse_eid
from adapters.bundle.codec.errors import BundleError, StoreError, StoreFull
from adapters.bundle.links.contact import ContactOverride, ContactPlan, load_contact_plan
from adapters.bundle.node.outbox import Queued
from adapters.bundle.node.reporting import DeliveryStatus, Notice
from adapters.bundle.node.settings import (
    DAY_S,
    Address,
    IonSettings,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
    engine_of,
)

__all__ = [
    "DAY_S",
    "DTN_EPOCH_UTC_MS",
    "Address",
    "AgentSettings",
    "BundleAgent",
    "BundleError",
    "BundleId",
    "ContactOverride",
    "ContactPlan",
    "Delivery",
    "DeliveryStatus",
    "Eid",
    "Health",
    "IonSettings",
    "Ipn",
    "Listen",
    "LtpLink",
    "Neighbour",
    "NeighbourHealth",
    "NodeSettings",
    "Notice",
    "Peer",
    "Queued",
    "StoreError",
    "StoreFull",
    "engine_of",
    "listen_error",
    "load_contact_plan",
    "make_agent",
    "node_of",
    "parse_eid",
]
