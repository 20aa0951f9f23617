"""The public RoboPianist, playing in a process of its own."""

from sb3_piano.bench.peer.client import INSTALL, Peer, PeerError

__all__ = ["INSTALL", "Peer", "PeerError"]
