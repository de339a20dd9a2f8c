"""CCSDS MAL 521.0-B-3 over TCP, as implemented by mo-services-java 12; see the README."""

from adapters.mal.attribute_codec import Encoding
from adapters.mal.broker import Keys, Publisher
from adapters.mal.codec import Codec
from adapters.mal.connection import SCHEME, Connection, MalUri
from adapters.mal.consumer import Consumer, OnUpdate, Publication
from adapters.mal.errors import MalError, StandardError
from adapters.mal.interaction import Interaction
from adapters.mal.mal_area import (
    NamedValue,
    NullableAttribute,
    ServiceId,
    Subscription,
    UpdateHeader,
)
from adapters.mal.message import Header, encode_message
from adapters.mal.provider import Call, Handler, Provider
from adapters.mal.specification import (
    Area,
    CompositeType,
    EnumerationType,
    Field,
    Operation,
    Pattern,
    Service,
    Specification,
    Stage,
)
from adapters.mal.specification_xml import load_specification
from adapters.mal.tls import CertificateError, Certificates
from adapters.mal.transactions import Progress
from adapters.mal.values import AttributeType, Typed, TypedList

__all__ = [
    "SCHEME",
    "Area",
    "AttributeType",
    "Call",
    "CertificateError",
    "Certificates",
    "Codec",
    "CompositeType",
    "Connection",
    "Consumer",
    "Encoding",
    "EnumerationType",
    "Field",
    "Handler",
    "Header",
    "Interaction",
    "Keys",
    "MalError",
    "MalUri",
    "NamedValue",
    "NullableAttribute",
    "OnUpdate",
    "Operation",
    "Pattern",
    "Progress",
    "Provider",
    "Publication",
    "Publisher",
    "Service",
    "ServiceId",
    "Specification",
    "Stage",
    "StandardError",
    "Subscription",
    "Typed",
    "TypedList",
    "UpdateHeader",
    "encode_message",
    "load_specification",
]
