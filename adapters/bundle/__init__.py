"""Bundle Protocol version 7 (RFC 9171): an agent with a durable store; knows nothing of rovers."""

from adapters.bundle.agent import BundleAgent, Delivery, Health, NeighbourHealth, make_agent
from adapters.bundle.codec.bundle import DTN_EPOCH_UTC_MS, BundleId
from adapters.bundle.codec.eid import Eid, Ipn, node_of, parse_eid
from adapters.bundle.codec.errors import BundleError, StoreError, StoreFull
from adapters.bundle.links.contact import Contact, ContactOverride, ContactPlan, load_contact_plan
from adapters.bundle.node.reporting import DeliveryStatus, Notice
from adapters.bundle.node.security import (
    KeySettings,
    PolicySettings,
    Security,
    SecuritySettings,
    load_security,
    make_key,
)
from adapters.bundle.node.settings import (
    DAY_S,
    Address,
    AgentSettings,
    IonSettings,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
    Peer,
    engine_of,
    listen_error,
)
from adapters.bundle.node.store import Queued
from adapters.bundle.node.traffic import Traffic

__all__ = [
    "DAY_S",
    "DTN_EPOCH_UTC_MS",
    "Address",
    "AgentSettings",
    "BundleAgent",
    "BundleError",
    "BundleId",
    "Contact",
    "ContactOverride",
    "ContactPlan",
    "Delivery",
    "DeliveryStatus",
    "Eid",
    "Health",
    "IonSettings",
    "Ipn",
    "KeySettings",
    "Listen",
    "LtpLink",
    "Neighbour",
    "NeighbourHealth",
    "NodeSettings",
    "Notice",
    "Peer",
    "PolicySettings",
    "Queued",
    "Security",
    "SecuritySettings",
    "StoreError",
    "StoreFull",
    "Traffic",
    "engine_of",
    "listen_error",
    "load_contact_plan",
    "load_security",
    "make_agent",
    "make_key",
    "node_of",
    "parse_eid",
]
