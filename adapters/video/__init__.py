"""The camera's video stream over UDP, from the rover to the ground."""

from adapters.video.forwarder import VideoForwarder as VideoForwarder
from adapters.video.forwarder import parse_address as parse_address
from adapters.video.jpeg_stream import JpegStream as JpegStream
