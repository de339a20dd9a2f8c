"""CCSDS MAL 521.0-B-3 over TCP, as implemented by mo-services-java 12; see the README."""

from adapters.mal.admission import Limits
from adapters.mal.attribute_codec import Encoding
from adapters.mal.broker import Keys, Publisher
from adapters.mal.codec import Codec, Header, encode_message
from adapters.mal.connection import SCHEME, Connection, MalUri
from adapters.mal.consumer import Consumer, Publication
from adapters.mal.errors import (
    DecodeError,
    EncodeError,
    MalError,
    SpecificationError,
    StandardError,
)
from adapters.mal.provider import Call, Handler, Interaction, Provider, UpdateError
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
from adapters.mal.tls import CertificateError, Certificates, address_to_listen, is_loopback
from adapters.mal.transactions import Invocation, OnUpdate, Progress
from adapters.mal.values import (
    AttributeType,
    NamedValue,
    NullableAttribute,
    Object,
    ObjectIdentity,
    ObjectRef,
    ServiceId,
    Subscription,
    SubscriptionFilter,
    Typed,
    TypedList,
    UpdateHeader,
)

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
    "DecodeError",
    "EncodeError",
    "Encoding",
    "EnumerationType",
    "Field",
    "Handler",
    "Header",
    "Interaction",
    "Invocation",
    "Keys",
    "Limits",
    "MalError",
    "MalUri",
    "NamedValue",
    "NullableAttribute",
    "Object",
    "ObjectIdentity",
    "ObjectRef",
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
    "SpecificationError",
    "Stage",
    "StandardError",
    "Subscription",
    "SubscriptionFilter",
    "Typed",
    "TypedList",
    "UpdateError",
    "UpdateHeader",
    "address_to_listen",
    "encode_message",
    "is_loopback",
    "load_specification",
]
