"""A rosbridge stand-in: the rosbridge protocol over a websocket of loopback, without a ROS behind it.

It knows the operations advertise, subscribe and publish, as
https://github.com/RobotWebTools/rosbridge_suite/blob/ros2/ROSBRIDGE_PROTOCOL.md has them.
"""

import json
import threading

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve


class RosbridgeStandIn:
    """Keeps what is published, and publishes to who subscribed."""

    def __init__(self, port=0):
        self._changed = threading.Condition()
        self.advertised, self.latest, self.counts, self.n_clients = {}, {}, {}, 0
        self._subscribers = {}
        self._clients = []
        self._server = serve(self._client, "127.0.0.1", port, max_size=None)
        self.port = self._server.socket.getsockname()[1]
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def _client(self, connection):
        with self._changed:
            self.n_clients += 1
            self._clients.append(connection)
            self._changed.notify_all()
        try:
            for text in connection:
                self._take(connection, json.loads(text))
        except ConnectionClosed:
            pass

    def _take(self, connection, message):
        with self._changed:
            topic = message["topic"]
            if message["op"] == "advertise":
                self.advertised[topic] = message["type"]
            elif message["op"] == "subscribe":
                self._subscribers[topic] = (connection, message["type"])
            elif message["op"] == "publish":
                assert topic in self.advertised
                self.latest[topic] = message["msg"]
                self.counts[topic] = self.counts.get(topic, 0) + 1
            self._changed.notify_all()

    def wait_for(self, claim, timeout=60.0):
        """Wait until something can be said of the stand-in."""
        with self._changed:
            assert self._changed.wait_for(lambda: claim(self), timeout), (self.counts, self.advertised)

    def publish(self, topic, message):
        """Have a subscriber hear a message."""
        self.wait_for(lambda own: topic in own._subscribers)
        connection, _ = self._subscribers[topic]
        connection.send(json.dumps({"op": "publish", "topic": topic, "msg": message}))

    def drop_clients(self):
        """End all connections as a bridge that is restarted does."""
        with self._changed:
            clients, self._clients = self._clients, []
            self.latest, self.counts, self._subscribers = {}, {}, {}
        for connection in clients:
            connection.close()

    def close(self):
        self._server.shutdown()
