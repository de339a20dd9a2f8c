"""The camera's video over UDP: forwarded aboard unchanged, reassembled from RTP on the ground."""

from adapters.video.forwarder import VideoForwarder as VideoForwarder
from adapters.video.forwarder import parse_address as parse_address
from adapters.video.jpeg_stream import JpegStream as JpegStream
