#!/usr/bin/env python3
"""Our MCAP files read by others' programs, and theirs by ours: the Python packages mcap, mcap-ros2-support and rosbags,
which share no code with us. Skipped (exit code 77) where they are not installed.

  mcap_peer_test.py MCAP_PEER     the program of tests/ros/mcap_peer.cpp
"""
import pathlib
import subprocess
import sys
import tempfile
import unittest

try:
    import mcap.reader
    import mcap.writer
    import mcap_ros2._dynamic
    import mcap_ros2.decoder
    import mcap_ros2.writer
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

PEER = sys.argv.pop() if len(sys.argv) > 1 else sys.exit(__doc__)
MESSAGES_A_TOPIC = 3


def peer(*arguments):
    run = subprocess.run([PEER, *map(str, arguments)], check=False, capture_output=True, text=True)
    if run.returncode:
        raise RuntimeError(run.stderr)
    return run.stdout


def decode(schema, message):
    return mcap_ros2.decoder.DecoderFactory().decoder_for("cdr", schema)(message.data)


HASHES = dict(line.split() for line in peer("types").splitlines())
COMPRESSIONS = ("none", "lz4", "zstd")


class McapFiles(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def ours(self, compression):
        file = self.folder / f"ours_{compression}.mcap"
        peer("write", file, compression)
        return file

    def check(self, file, by="by index"):
        self.assertEqual(peer("check", file), f"{MESSAGES_A_TOPIC * len(HASHES)} messages, {by}\n")

    def store_with_types_of(self, connections):
        """The package's own definitions; of what it does not know, those in the file."""
        store = get_typestore(Stores.ROS2_JAZZY)
        own = set(store.fielddefs)
        for connection in connections:
            types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
            store.register({name: fields for name, fields in types.items() if name not in store.fielddefs})
        return store, own

    # --- Ours, read by others.

    def test_mcap_reads_ours_and_finds_every_checksum_right(self):
        for compression in COMPRESSIONS:
            file = self.ours(compression)
            with file.open("rb") as stream:
                reader = mcap.reader.make_reader(stream, validate_crcs=True)
                self.assertIsInstance(reader, mcap.reader.SeekingReader)
                self.assertEqual(reader.get_header().profile, "ros2")
                summary = reader.get_summary()
                messages = list(reader.iter_messages())
                self.assertEqual(list(reader.iter_metadata())[0].metadata, {"language": "C++"})
            self.assertEqual(len(messages), MESSAGES_A_TOPIC * len(HASHES))
            self.assertEqual(summary.statistics.message_count, len(messages))
            self.assertEqual(summary.statistics.chunk_count, len(summary.chunk_indexes))
            self.assertGreater(len(summary.chunk_indexes), 2)
            for schema, channel, _ in messages:
                self.assertEqual((schema.encoding, channel.message_encoding), ("ros2msg", "cdr"))
                self.assertIn("history: 1", channel.metadata["offered_qos_profiles"])
            with file.open("rb") as stream:  # From front to back, which looks at the data section's checksum.
                reader = mcap.reader.NonSeekingReader(stream, validate_crcs=True)
                self.assertEqual(len(list(reader.iter_messages())), len(messages))

    def test_mcap_ros2_decodes_by_our_schemas_and_encodes_the_same_bytes(self):
        with self.ours("zstd").open("rb") as stream:
            for schema, _, message in mcap.reader.make_reader(stream).iter_messages():
                decoded = decode(schema, message)
                encoders = mcap_ros2._dynamic.serialize_dynamic(schema.name, schema.data.decode())
                self.assertEqual(bytes(encoders[schema.name](decoded)), message.data, schema.name)

    def test_rosbags_decodes_by_its_own_types_and_encodes_the_same_bytes(self):
        for compression in COMPRESSIONS:
            with Reader(self.ours(compression)) as reader:
                store, own = self.store_with_types_of(reader.connections)
                self.assertIn("sensor_msgs/msg/Image", own)
                count = 0
                for connection, _, data in reader.messages():
                    message = store.deserialize_cdr(data, connection.msgtype)
                    again = store.serialize_cdr(message, connection.msgtype)
                    self.assertEqual(bytes(again), bytes(data), connection.msgtype)
                    count += 1
            self.assertEqual(count, MESSAGES_A_TOPIC * len(HASHES))

    def test_rosbags_computes_the_same_type_hashes(self):
        with Reader(self.ours("none")) as reader:
            store, own = self.store_with_types_of(reader.connections)
        for name, ours in HASHES.items():
            if name.startswith("rmw_dds_common/"):
                continue  # rosbags takes their char for a type of its own; ROS 2 makes it uint8 before it hashes.
            self.assertEqual(store.hash_rihs01(name), ours, name)
        self.assertGreater(len(own & set(HASHES)), 25)

    # --- Others', read by us.

    def decoded(self):
        with self.ours("lz4").open("rb") as stream:
            for schema, channel, message in mcap.reader.make_reader(stream).iter_messages():
                yield schema, channel, message, decode(schema, message)

    def test_ours_reads_mcap_ros2(self):
        for compression in mcap.writer.CompressionType:
            file = self.folder / f"theirs_{compression.name}.mcap"
            with file.open("wb") as stream:
                writer = mcap_ros2.writer.Writer(stream, chunk_size=5000, compression=compression)
                schemas = {}
                for schema, channel, message, decoded in self.decoded():
                    if schema.name not in schemas:
                        schemas[schema.name] = writer.register_msgdef(schema.name, schema.data.decode())
                    writer.write_message(channel.topic, schemas[schema.name], decoded, message.log_time)
                writer.finish()
            self.check(file)

    def write_raw(self, file, **options):
        with file.open("wb") as stream:
            writer = mcap.writer.Writer(stream, **options)
            writer.start(profile="ros2")
            channels = {}
            for schema, channel, message, _ in self.decoded():
                if channel.topic not in channels:
                    schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(channel.topic, "cdr", schema_id)
                writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
            writer.finish()

    def test_ours_reads_files_without_chunks_indexes_summaries_and_checksums(self):
        none = mcap.writer.IndexType.NONE
        message_index = mcap.writer.IndexType.MESSAGE
        cases = {
            "unchunked": ({"use_chunking": False}, "scanned"),
            "no_index": ({"index_types": none}, "scanned"),
            "no_message_index": ({"index_types": mcap.writer.IndexType.ALL & ~message_index}, "by index"),
            "no_statistics": ({"use_statistics": False}, "by index"),
            "no_summary": ({"use_statistics": False, "index_types": none, "use_summary_offsets": False,
                            "repeat_channels": False}, "scanned"),
            "no_checksums": ({"enable_crcs": False}, "by index"),
        }
        for name, (options, by) in cases.items():
            with self.subTest(name):
                file = self.folder / f"{name}.mcap"
                self.write_raw(file, **options)
                self.check(file, by)

    def test_ours_reads_what_is_left_of_a_file(self):
        file = self.folder / "whole.mcap"
        self.write_raw(file, chunk_size=5000)
        whole = file.read_bytes()
        counts = []
        for part in (0.2, 0.5, 0.8, 0.999):
            left = self.folder / "left.mcap"
            left.write_bytes(whole[:int(part * len(whole))])
            count, by = peer("check", left).split(" messages, ")
            self.assertEqual(by, "scanned\n")
            counts.append(int(count))
        self.assertEqual(counts, sorted(counts))
        self.assertLess(counts[0], counts[-1])

    def test_ours_reads_rosbags(self):
        for mode in (CompressionMode.NONE, CompressionMode.STORAGE):
            folder = self.folder / f"bag_{mode.name}"
            with Reader(self.ours("lz4")) as reader:
                store, _ = self.store_with_types_of(reader.connections)
                writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
                writer.set_compression(mode, CompressionFormat.ZSTD)
                with writer:
                    connections = {}
                    for connection, time_ns, data in reader.messages():
                        if connection.topic not in connections:
                            connections[connection.topic] = writer.add_connection(
                                connection.topic, connection.msgtype, typestore=store)
                        message = store.deserialize_cdr(data, connection.msgtype)
                        again = store.serialize_cdr(message, connection.msgtype)
                        writer.write(connections[connection.topic], time_ns, again)
            self.check(next(folder.glob("*.mcap")))


if __name__ == "__main__":
    unittest.main()
