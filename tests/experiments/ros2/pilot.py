"""A participant of DDS that shares nothing with this project: the package cyclonedds of PyPI, with types of its own.

    python3 pilot.py DOMAIN     drives the robot on that domain to its goals until it is ended

It looks around, drives towards the goal when a detection names it, stops in front of it, and turns away from what the
depth image shows ahead. Exit code 77: the package is not installed.
"""
import math
import random
import sys
from dataclasses import dataclass

try:
    import numpy as np
    from cyclonedds.core import Policy, Qos, ReadCondition, ViewState, InstanceState, SampleState, WaitSet
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl.annotations import final
    from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration
except ImportError as error:
    print(error)
    sys.exit(77)

LOOPBACK = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""


@final
@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32


@final
@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@final
@dataclass
class String(IdlStruct, typename="std_msgs.msg.dds_.String_"):
    data: str


@final
@dataclass
class Bool(IdlStruct, typename="std_msgs.msg.dds_.Bool_"):
    data: bool


@final
@dataclass
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    x: float64
    y: float64
    z: float64


@final
@dataclass
class Twist(IdlStruct, typename="geometry_msgs.msg.dds_.Twist_"):
    linear: Vector3
    angular: Vector3


@final
@dataclass
class Image(IdlStruct, typename="sensor_msgs.msg.dds_.Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@final
@dataclass
class RegionOfInterest(IdlStruct, typename="sensor_msgs.msg.dds_.RegionOfInterest_"):
    x_offset: uint32
    y_offset: uint32
    height: uint32
    width: uint32
    do_rectify: bool


@final
@dataclass
class CameraInfo(IdlStruct, typename="sensor_msgs.msg.dds_.CameraInfo_"):
    header: Header
    height: uint32
    width: uint32
    distortion_model: str
    d: sequence[float64]
    k: array[float64, 9]
    r: array[float64, 9]
    p: array[float64, 12]
    binning_x: uint32
    binning_y: uint32
    roi: RegionOfInterest


@final
@dataclass
class ObjectHypothesis(IdlStruct, typename="vision_msgs.msg.dds_.ObjectHypothesis_"):
    class_id: str
    score: float64


@final
@dataclass
class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    x: float64
    y: float64
    z: float64


@final
@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@final
@dataclass
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    position: Point
    orientation: Quaternion


@final
@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@final
@dataclass
class ObjectHypothesisWithPose(IdlStruct, typename="vision_msgs.msg.dds_.ObjectHypothesisWithPose_"):
    hypothesis: ObjectHypothesis
    pose: PoseWithCovariance


@final
@dataclass
class Point2D(IdlStruct, typename="vision_msgs.msg.dds_.Point2D_"):
    x: float64
    y: float64


@final
@dataclass
class Pose2D(IdlStruct, typename="vision_msgs.msg.dds_.Pose2D_"):
    position: Point2D
    theta: float64


@final
@dataclass
class BoundingBox2D(IdlStruct, typename="vision_msgs.msg.dds_.BoundingBox2D_"):
    center: Pose2D
    size_x: float64
    size_y: float64


@final
@dataclass
class Detection2D(IdlStruct, typename="vision_msgs.msg.dds_.Detection2D_"):
    header: Header
    results: sequence[ObjectHypothesisWithPose]
    bbox: BoundingBox2D
    id: str


@final
@dataclass
class Detection2DArray(IdlStruct, typename="vision_msgs.msg.dds_.Detection2DArray_"):
    header: Header
    detections: sequence[Detection2D]


def qos(depth, latched=False):
    """As rclcpp and rclpy ask for: reliable, with a history of that depth."""
    durability = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
    return Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(depth), durability,
               Policy.DataRepresentation(use_cdrv0_representation=True))


def taken(reader):
    """Messages; not the news that a writer has gone."""
    return [sample for sample in reader.take(16) if sample.sample_info.valid_data]


def stamp_of(sample):
    return sample.header.stamp.sec, sample.header.stamp.nanosec


class Pilot:
    def __init__(self, domain):
        self.domain = Domain(domain, LOOPBACK)
        self.participant = DomainParticipant(domain)
        self.goals = self.reader("goal_object", String, qos(1, latched=True))
        self.images = self.reader("camera/image_raw", Image, qos(5))
        self.depths = self.reader("camera/depth/image_raw", Image, qos(5))
        self.infos = self.reader("camera/camera_info", CameraInfo, qos(5))
        self.found = self.reader("detections", Detection2DArray, qos(10))
        self.command = self.writer("cmd_vel", Twist)
        self.stop = self.writer("stop", Bool)
        self.waits = WaitSet(self.participant)
        self.condition = ReadCondition(self.images, ViewState.Any | InstanceState.Any | SampleState.Any)
        self.waits.attach(self.condition)
        self.latest = {}  # By stamp: what belongs to an image.
        self.goal = None
        self.turn_until_s = 0.0
        self.random = random.Random(7)

    def reader(self, name, message_type, of):
        return DataReader(self.participant, Topic(self.participant, "rt/" + name, message_type), of)

    def writer(self, name, message_type):
        return DataWriter(self.participant, Topic(self.participant, "rt/" + name, message_type), qos(10))

    def run(self):
        while True:
            self.waits.wait(duration(milliseconds=20))
            for goal in taken(self.goals):
                self.goal = goal.data
                self.latest.clear()
                self.turn_until_s = 8.0  # It looks around first.
            for name, reader in [("depth", self.depths), ("info", self.infos), ("found", self.found),
                                 ("rgb", self.images)]:
                for sample in taken(reader):
                    self.latest.setdefault(stamp_of(sample), {})[name] = sample
            for stamp in sorted(self.latest):
                if self.goal and len(self.latest[stamp]) == 4:
                    self.answer(stamp, **self.latest.pop(stamp))

    def answer(self, stamp, rgb, depth, info, found):
        """Sends the velocity for what the robot sees, or that it is there."""
        assert rgb.encoding == "rgb8" and len(rgb.data) == rgb.width * rgb.height * 3, rgb.encoding
        assert depth.encoding == "32FC1" and depth.header.frame_id == "camera_optical_frame", depth.encoding
        depth_m = np.frombuffer(bytes(depth.data), np.float32).reshape(depth.height, depth.width)
        middle_m = depth_m[depth.height // 3:2 * depth.height // 3, depth.width // 3:2 * depth.width // 3]
        ahead_m = float(np.nanmin(middle_m)) if np.isfinite(middle_m).any() else 10.0
        now_s = stamp[0] + stamp[1] * 1e-9
        for one in found.detections:
            if one.results[0].hypothesis.class_id == self.goal:
                left_rad = math.atan((info.k[2] - one.bbox.center.position.x) / info.k[0])
                if abs(left_rad) < 0.2 and ahead_m < 1.0:
                    self.goal = None
                    return self.stop.write(Bool(True))
                return self.drive(0.4 if abs(left_rad) < 0.2 else 0.0, left_rad)
        if now_s > self.turn_until_s and ahead_m < 1.2:
            self.turn_until_s = now_s + self.random.uniform(0.5, 4.0)
        return self.drive(0.0, 0.8) if now_s < self.turn_until_s else self.drive(0.6, 0.0)

    def drive(self, forward_mps, turn_radps):
        self.command.write(Twist(Vector3(forward_mps, 0.0, 0.0), Vector3(0.0, 0.0, turn_radps)))


Pilot(int(sys.argv[1])).run()
