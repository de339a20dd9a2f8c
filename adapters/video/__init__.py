"""The camera's video stream over UDP, from the rover to the ground."""

from adapters.video.forwarder import VideoForwarder, parse_address
from adapters.video.jpeg_stream import JpegStream

__all__ = ["JpegStream", "VideoForwarder", "parse_address"]
