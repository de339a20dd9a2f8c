"""The XML against a table written down apart from it."""

import subprocess
import sys
from pathlib import Path

import pytest

from adapters.mal import CompositeType, EnumerationType, Field, Pattern, Stage
from adapters.mrs.spec import types
from adapters.mrs.spec.errors import AreaError
from adapters.mrs.spec.interface_page import interface_page
from adapters.mrs.spec.requests import REQUESTS
from adapters.mrs.spec.specification import MRS_XML, mrs_specification

AREA = next(area for area in mrs_specification().areas if area.name == "MRS")
SERVICES = {
    "ServiceLayer": "getServices getService registerService deregisterService getAsset",
    "Notification": "sendNotification monitorNotification getNotifications",
    "Monitoring": "publishParameters monitorValue getValue listDefinition",
    "FileTransfer": "listFiles retrieveFile cancelTransfer",
    "FileManagement": "fileStored monitorFiles getAttributes delete move",
    "Action": "execute listActions",
    "Camera": "takePicture setAngles moveAngles setRotateSpeed getState",
    "MotionControl": "moveTo moveForward rotateTo rotateBy drive followPath stop resume"
    " setTravelSpeed setRotateSpeed setPositionCompensation getPose getSpeeds",
    "Plan": "submitPlan activatePlan suspendPlan resumePlan abortPlan removePlan getPlanStatus"
    " monitorPlanExecution",
    "Status": "setStatusInterval getStatusInterval getStatus",
    "MonitoringClient": "listAssets getValue monitorAssetValue",
    "NotificationClient": "getNotifications monitorAssetNotification",
}
COMPOSITES = {
    "CommandHeader": "20 commandId:Long source:Identifier counter:UInteger? lifetime:Duration?"
    " creationTime:Time? reportStarted:Boolean reportProgress:Boolean",
    "Notification": "21 kind:NotificationKind severity:Severity timestamp:Time sequence:ULong"
    " commandId:Long? source:Identifier? stage:Stage? step:UInteger? stepCount:UInteger?"
    " code:UInteger? text:String? parameters:[NamedValue]?",
    "ParameterDefinition": "22 name:Identifier description:String type:AttributeType"
    " unit:String? writable:Boolean",
    "ParameterValue": "23 name:Identifier timestamp:Time validity:Validity value:Attribute?",
    "Pose": "24 frame:Identifier x:Double y:Double z:Double heading:Double",
    "Speeds": "25 travelSpeed:Double rotateSpeed:Double currentTravelSpeed:Double"
    " currentRotateSpeed:Double",
    "Waypoint": "26 x:Double y:Double heading:Double? tolerance:Double?",
    "CameraState": "27 pan:Double tilt:Double rotateSpeed:Double videoOn:Boolean",
    "PictureSettings": "28 width:UInteger? height:UInteger? format:Identifier? quality:UOctet?",
    "FileInfo": "29 path:String size:ULong modified:Time mimeType:String? checksum:UInteger?"
    " metaData:[NamedValue]?",
    "FileChunk": "30 offset:ULong data:Blob",
    "FileReport": "31 path:String octets:ULong checksum:UInteger",
    "PlanDefinition": "32 planId:Identifier name:String format:Identifier content:Blob"
    " arguments:[NamedValue]?",
    "PlanUpdate": "33 planId:Identifier status:PlanStatus timestamp:Time node:String?"
    " done:UInteger? total:UInteger? text:String?",
    "AssetInfo": "34 asset:Identifier domain:[Identifier] description:String"
    " softwareVersion:String mode:AssetMode",
    "ServiceDescriptor": "35 name:Identifier service:ServiceId providerURI:URI brokerURI:URI?"
    " operations:[UShort]",
    "AssetStatus": "36 timestamp:Time mode:AssetMode activeCommandId:Long?"
    " queuedCommands:UInteger activePlan:Identifier? values:[ParameterValue]",
}
ENUMERATIONS = {
    "Stage": "1 RECEIVED=1 ACCEPTED=2 REJECTED=3 STARTED=4 PROGRESS=5 EXECUTED=6 FAILED=7"
    " CANCELLED=8 EXPIRED=9",
    "Severity": "2 INFORMATIONAL=1 WARNING=2 ALARM=3 SEVERE=4 CRITICAL=5",
    "NotificationKind": "3 COMMAND=1 EVENT=2 LINK=3",
    "Validity": "4 VALID=0 EXPIRED=1 INVALID_RAW=2 INVALID_CONVERSION=3 UNVERIFIED=4 INVALID=5",
    "AssetMode": "5 IDLE=1 MOVING=2 TELEOP=3 PLAN=4 PAUSED=5 STOPPED=6 SAFE=7 OFFLINE=8",
    "FileEventType": "6 STORED=1 CHANGED=2 DELETED=3 TRANSFERRED=4",
    "PlanStatus": "7 SUBMITTED=1 ACTIVATED=2 EXECUTING=3 SUSPENDED=4 COMPLETED=5 FAILED=6"
    " ABORTED=7",
}
HEADER = "command:CommandHeader"
MESSAGES = {
    ("ServiceLayer", "getService", Stage.REQUEST): "name:Identifier",
    ("ServiceLayer", "getServices", Stage.REQUEST_RESPONSE): "services:[ServiceDescriptor]",
    ("Notification", "getNotifications", Stage.REQUEST): "since:ULong? commandId:Long?"
    " maxCount:UInteger",
    ("Notification", "monitorNotification", Stage.PUBLISH): "updateHeader:UpdateHeader"
    " notification:Notification",
    ("Monitoring", "getValue", Stage.REQUEST): "names:[Identifier]",
    ("FileTransfer", "listFiles", Stage.REQUEST): "folder:String?",
    ("FileTransfer", "retrieveFile", Stage.PROGRESS): "path:String offset:ULong?"
    " chunkSize:UInteger?",
    ("FileTransfer", "retrieveFile", Stage.PROGRESS_UPDATE): "chunk:FileChunk",
    ("FileTransfer", "retrieveFile", Stage.PROGRESS_RESPONSE): "report:FileReport",
    ("FileManagement", "move", Stage.SUBMIT): f"{HEADER} path:String target:String",
    ("Action", "execute", Stage.SUBMIT): f"{HEADER} action:String",
    ("Camera", "takePicture", Stage.SUBMIT): f"{HEADER} settings:PictureSettings?",
    ("Camera", "setAngles", Stage.SUBMIT): f"{HEADER} pan:Double? tilt:Double?",
    ("Camera", "moveAngles", Stage.SUBMIT): f"{HEADER} pan:Double tilt:Double",
    ("MotionControl", "moveTo", Stage.SUBMIT): f"{HEADER} target:Waypoint",
    ("MotionControl", "drive", Stage.SUBMIT): f"{HEADER} travel:Double rotate:Double"
    " duration:Duration",
    ("MotionControl", "followPath", Stage.SUBMIT): f"{HEADER} waypoints:[Waypoint]",
    ("MotionControl", "stop", Stage.SUBMIT): HEADER,
    ("MotionControl", "setPositionCompensation", Stage.SUBMIT): f"{HEADER} x:Double y:Double"
    " z:Double heading:Double",
    ("Plan", "submitPlan", Stage.SUBMIT): f"{HEADER} plan:PlanDefinition",
    ("Plan", "getPlanStatus", Stage.REQUEST): "planIds:[Identifier]",
    ("Status", "setStatusInterval", Stage.SUBMIT): f"{HEADER} interval:Duration",
    ("NotificationClient", "getNotifications", Stage.REQUEST): "asset:Identifier since:ULong?"
    " maxCount:UInteger",
}
FULL = ("Invalid", "Rejected", "Duplicate", "NotSupported", "Busy")


def written(fields: tuple[Field, ...]) -> str:
    """Write fields as the tables above do."""
    names = (f"[{f.type.name}]" if f.type.is_list else f.type.name for f in fields)
    return " ".join(
        f"{f.name}:{name}{'?' if f.nullable else ''}" for f, name in zip(fields, names, strict=True)
    )


def test_has_the_area() -> None:
    assert (AREA.name, AREA.number, AREA.version) == ("MRS", 3001, 1)


def test_has_all_services_and_operations_in_their_order() -> None:
    found = {s.name: " ".join(operation.name for operation in s.operations) for s in AREA.services}
    assert found == SERVICES
    assert [service.number for service in AREA.services] == list(range(1, 13))
    assert sum(len(service.operations) for service in AREA.services) == 56
    for service in AREA.services:
        numbers = [operation.number for operation in service.operations]
        assert numbers == list(range(1, len(numbers) + 1))


def test_has_the_patterns() -> None:
    patterns = dict.fromkeys(Pattern, 0)
    for service in AREA.services:
        for operation in service.operations:
            patterns[operation.pattern] += 1
            monitors = operation.name.startswith("monitor")
            assert (operation.pattern is Pattern.PUBSUB) == monitors
    assert patterns == {
        Pattern.SEND: 0,
        Pattern.SUBMIT: 31,
        Pattern.REQUEST: 18,
        Pattern.INVOKE: 0,
        Pattern.PROGRESS: 1,
        Pattern.PUBSUB: 6,
    }


def test_has_the_composites() -> None:
    found = {
        t.name: f"{t.short_form} {written(t.fields)}"
        for t in AREA.types
        if isinstance(t, CompositeType)
    }
    assert found == COMPOSITES


def test_has_the_enumerations() -> None:
    found = {
        t.name: f"{t.short_form} " + " ".join(f"{item.name}={item.value}" for item in t.items)
        for t in AREA.types
        if isinstance(t, EnumerationType)
    }
    assert found == ENUMERATIONS


@pytest.mark.parametrize(("address", "parts"), MESSAGES.items())
def test_has_the_messages(address: tuple[str, str, Stage], parts: str) -> None:
    service, operation, stage = address
    assert written(mrs_specification().operation(service, operation).parts[stage]) == parts


def test_has_the_subscription_keys() -> None:
    keys = {
        f"{service.name}.{operation.name}": written(operation.keys)
        for service in AREA.services
        for operation in service.operations
        if operation.keys
    }
    of_notifications = "asset:Identifier kind:UOctet severity:UOctet commandId:Long? stage:UOctet?"
    assert keys == {
        "Notification.monitorNotification": of_notifications,
        "Monitoring.monitorValue": "asset:Identifier parameter:Identifier",
        "FileManagement.monitorFiles": "asset:Identifier event:UOctet mimeType:String",
        "Plan.monitorPlanExecution": "asset:Identifier planId:Identifier status:UOctet",
        "MonitoringClient.monitorAssetValue": "asset:Identifier parameter:Identifier",
        "NotificationClient.monitorAssetNotification": of_notifications,
    }


def test_has_the_errors() -> None:
    numbers = {error.name: error.number for error in AREA.errors}
    assert numbers == {
        "Invalid": 1,
        "Rejected": 2,
        "Duplicate": 3,
        "NotSupported": 4,
        "NotFound": 5,
        "Busy": 6,
    }
    assert {error.value for error in AreaError} == set(numbers.values())


def test_operations_name_their_errors() -> None:
    specification = mrs_specification()
    for name in SERVICES["MotionControl"].split():
        always = ("Duplicate", "Invalid", "Rejected")
        wanted = () if name.startswith("get") else always if name == "stop" else FULL
        assert specification.operation("MotionControl", name).errors == wanted
    assert specification.operation("FileManagement", "move").errors == (
        "NotFound",
        "Rejected",
        "Duplicate",
        "Invalid",
        "Busy",
    )


def test_every_command_names_what_may_refuse_it() -> None:
    specification = mrs_specification()
    for service, name in REQUESTS:
        errors = specification.operation(service, name).errors
        assert {"Duplicate", "Invalid", "Rejected"} <= set(errors), (service, name)


def test_commands_begin_with_the_header() -> None:
    tells = {"registerService", "deregisterService", "sendNotification", "publishParameters"}
    tells |= {"cancelTransfer", "fileStored"}
    for service in AREA.services:
        for operation in service.operations:
            if operation.pattern is Pattern.SUBMIT and operation.name not in tells:
                assert written(operation.parts[Stage.SUBMIT][:1]) == HEADER


def test_the_types_are_generated_from_it() -> None:
    generated = subprocess.run(
        [sys.executable, "-m", "adapters.mal.generate", str(MRS_XML)],
        check=True,
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
    ).stdout
    assert types.__file__ is not None
    assert Path(types.__file__).read_text() == generated


def test_the_interface_page_is_written_from_it() -> None:
    page = Path(__file__).parents[2] / "docs" / "mrs.md"
    assert page.read_text() == interface_page() + "\n", (
        "python -m adapters.mrs.spec.interface_page > docs/mrs.md"
    )
