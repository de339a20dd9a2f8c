"""CCSDS MAL 521.0-B-3 over TCP, as implemented by mo-services-java 12; see the README."""

from adapters.mal.attribute_codec import Encoding
from adapters.mal.broker import Keys, Publisher
from adapters.mal.codec import Codec
from adapters.mal.connection import SCHEME, Connection, MalUri
from adapters.mal.consumer import Consumer, Publication
from adapters.mal.errors import (
    DecodeError,
    EncodeError,
    MalError,
    SpecificationError,
    StandardError,
)
from adapters.mal.interaction import Call, Handler, Interaction, UpdateError
from adapters.mal.mal_area import (
    File,
    IdBooleanPair,
    InteractionType,
    MOArea,
    NamedValue,
    NullableAttribute,
    Object,
    ObjectIdentity,
    Pair,
    QoSLevel,
    ServiceId,
    SessionType,
    Subscription,
    SubscriptionFilter,
    UpdateHeader,
)
from adapters.mal.message import Header, encode_message
from adapters.mal.provider import Provider
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
from adapters.mal.transactions import Invocation, OnUpdate, Progress
from adapters.mal.values import AttributeType, ObjectRef, Typed, TypedList

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
    "File",
    "Handler",
    "Header",
    "IdBooleanPair",
    "Interaction",
    "InteractionType",
    "Invocation",
    "Keys",
    "MOArea",
    "MalError",
    "MalUri",
    "NamedValue",
    "NullableAttribute",
    "Object",
    "ObjectIdentity",
    "ObjectRef",
    "OnUpdate",
    "Operation",
    "Pair",
    "Pattern",
    "Progress",
    "Provider",
    "Publication",
    "Publisher",
    "QoSLevel",
    "Service",
    "ServiceId",
    "SessionType",
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
    "encode_message",
    "load_specification",
]
