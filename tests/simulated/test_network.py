"""The simulated network: by itself, under the product's MAL, and under its bundle agents."""

import asyncio
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import pytest

import adapters.bundle.agent
import adapters.bundle.links.udp
import adapters.mal.admission
import adapters.mal.connection
from adapters.bundle.agent import BundleAgent
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.database import Synchronous
from adapters.bundle.node.settings import Address, AnyLink, Listen, Neighbour, NodeSettings
from adapters.bundle.node.settings import TcpclLink, UdpLink
from adapters.mal import Consumer, MalError, Provider, load_specification
from tests.simulated.network import Way
from tests.simulated.process import Process
from tests.simulated.system import SimSystem
from tests.simulated.world import World

Main = Callable[[Process], Coroutine[Any, Any, object]]
A, B = "10.0.0.1", "10.0.0.2"
