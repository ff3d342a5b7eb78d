#include "ros/type_description.h"

#include <map>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/messages/all_messages.h"

namespace segsim::ros {
namespace {

/// Computed once from the .msg files of ROS 2 by another program, in Python. Those of 12
/// types, sensor_msgs/Image and nav_msgs/Odometry among them, equal published ones (ROS 2
/// Jazzy).
const std::map<std::string, std::string> kHashes = {
    {"builtin_interfaces/Time",
     "RIHS01_b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197"},
    {"builtin_interfaces/Duration",
     "RIHS01_e8d009f659816f758b75334ee1a9ca5b5c0b859843261f14c7f937349599d93b"},
    {"std_msgs/Header",
     "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"},
    {"std_msgs/String",
     "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"},
    {"std_msgs/Bool",
     "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9"},
    {"std_msgs/ColorRGBA",
     "RIHS01_77a7a5b9ae477306097665106e0413ba74440245b1f3d0c6d6405fe5c7813fe8"},
    {"rosgraph_msgs/Clock",
     "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564"},
    {"sensor_msgs/Image",
     "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"},
    {"sensor_msgs/CompressedImage",
     "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"},
    {"sensor_msgs/RegionOfInterest",
     "RIHS01_ad16bcba5f9131dcdba6fbded19f726f5440e3c513b4fb586dd3027eeed8abb1"},
    {"sensor_msgs/CameraInfo",
     "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"},
    {"sensor_msgs/LaserScan",
     "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828"},
    {"sensor_msgs/PointField",
     "RIHS01_5c6a4750728c2bcfbbf7037225b20b02d4429634732146b742dee1726637ef01"},
    {"sensor_msgs/PointCloud2",
     "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"},
    {"geometry_msgs/Vector3",
     "RIHS01_cc12fe83e4c02719f1ce8070bfd14aecd40f75a96696a67a2a1f37f7dbb0765d"},
    {"geometry_msgs/Point",
     "RIHS01_6963084842a9b04494d6b2941d11444708d892da2f4b09843b9c43f42a7f6881"},
    {"geometry_msgs/Quaternion",
     "RIHS01_8a765f66778c8ff7c8ab94afcc590a2ed5325a1d9a076ffff38fbce36f458684"},
    {"geometry_msgs/Pose",
     "RIHS01_d501954e9476cea2996984e812054b68026ae0bfae789d9a10b23daf35cc90fa"},
    {"geometry_msgs/PoseStamped",
     "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"},
    {"geometry_msgs/Pose2D",
     "RIHS01_d68efa5b46e70f7b16ca23085474fdac5a44b638783ec42f661da64da4724ccc"},
    {"geometry_msgs/PoseWithCovariance",
     "RIHS01_9a7c0fd234b7f45c6098745ecccd773ca1085670e64107135397aee31c02e1bb"},
    {"geometry_msgs/Twist",
     "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"},
    {"geometry_msgs/TwistWithCovariance",
     "RIHS01_49f574f033f095d8b6cd1beaca5ca7925e296e84af1716d16c89d38b059c8c18"},
    {"geometry_msgs/TwistStamped",
     "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64"},
    {"geometry_msgs/Transform",
     "RIHS01_beb83fbe698636351461f6f35d1abb20010c43d55374d81bd041f1ba2581fddc"},
    {"geometry_msgs/TransformStamped",
     "RIHS01_0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206"},
    {"tf2_msgs/TFMessage",
     "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"},
    {"nav_msgs/Odometry",
     "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"},
    {"nav_msgs/MapMetaData",
     "RIHS01_2772d4b2000ef2b35dbaeb80fd3946c1369f817fb4f75677d916d27c17d763c8"},
    {"nav_msgs/OccupancyGrid",
     "RIHS01_8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7"},
    {"nav_msgs/Path",
     "RIHS01_1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b"},
    {"sensor_msgs/Imu",
     "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"},
    {"sensor_msgs/NavSatStatus",
     "RIHS01_d1ed3befa628e09571bd273b888ba1c1fd187c9a5e0006b385d7e5e9095a3204"},
    {"sensor_msgs/NavSatFix",
     "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"},
    {"vision_msgs/ObjectHypothesis",
     "RIHS01_51da43cec11c01957a64d1e05a24acd18aae7745ec30b74348ad5f6d634f7f90"},
    {"vision_msgs/ObjectHypothesisWithPose",
     "RIHS01_41c12344c0396c48b81df12467c192d99b2a0eb1463c5c37194e4223251c80bc"},
    {"vision_msgs/Point2D",
     "RIHS01_eab0e83f44ab4de92ceaf76dd7d0e7638f2bdd1d16ffbe16c7a136c48e407247"},
    {"vision_msgs/Pose2D",
     "RIHS01_b0b5d1d7b4c20dd4fcde3ed1d4b289a919290572007d67a97043814db25d3648"},
    {"vision_msgs/BoundingBox2D",
     "RIHS01_008eacbb0cf8f26e83795547bed013eec3675485ef386ec056d80eaaf1c1ce2f"},
    {"vision_msgs/Detection2D",
     "RIHS01_0d12b69df5c593b3455b7346fac8205437a7d4bcb09b9e0e0b2dde787ded38ea"},
    {"vision_msgs/Detection2DArray",
     "RIHS01_214274120007f4a683866481336b70310268cfa107aebe9d594a6acf75bda968"},
    {"rmw_dds_common/Gid",
     "RIHS01_ab6f21cfbb0a6dbb837161e1110c2051a2850ed9f9c53944d7115d9bcebedf71"},
    {"rmw_dds_common/NodeEntitiesInfo",
     "RIHS01_8ffef65ee2d088c63b1e8fcd31e800ba9fc8dbe0ee15ca60d1676de5218087a7"},
    {"rmw_dds_common/ParticipantEntitiesInfo",
     "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e"},
};

template <class... M>
void check_all(std::tuple<M...>* /*all*/, auto&& check) {
  (check(M{}), ...);
}

TEST(TypeDescription, HashesAreThoseOfRos2) {
  std::size_t compared = 0;
  check_all(static_cast<AllMessages*>(nullptr), [&](auto message) {
    using M = decltype(message);
    const auto expected = kHashes.find(short_name(M::kType));
    ASSERT_NE(expected, kHashes.end()) << short_name(M::kType);
    EXPECT_EQ(rihs01(describe<M>()), expected->second) << short_name(M::kType);
    ++compared;
  });
  EXPECT_EQ(compared, kHashes.size());
}

TEST(TypeDescription, TextListsFieldsThenReferencedTypes) {
  const std::string line(80, '=');
  EXPECT_EQ(ros2msg_text(describe<std_msgs::Header>()),
            "builtin_interfaces/Time stamp\nstring frame_id\n" + line +
                "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n");
}

TEST(TypeDescription, TextNamesArraysAndSequences) {
  const std::string text = ros2msg_text(describe<sensor_msgs::CameraInfo>());
  EXPECT_THAT(text, ::testing::HasSubstr("float64[] d\nfloat64[9] k\n"));
  EXPECT_THAT(text, ::testing::HasSubstr("sensor_msgs/RegionOfInterest roi\n"));
}

TEST(TypeDescription, EachReferencedTypeComesOnce) {
  const TypeClosure closure = describe<nav_msgs::Path>();
  std::vector<std::string> names;
  for (const TypeDescription& type : closure.referenced) names.push_back(type.full_name());
  EXPECT_THAT(names,
              ::testing::ElementsAre("builtin_interfaces/msg/Time", "geometry_msgs/msg/Point",
                                     "geometry_msgs/msg/Pose", "geometry_msgs/msg/PoseStamped",
                                     "geometry_msgs/msg/Quaternion", "std_msgs/msg/Header"));
}

}  // namespace
}  // namespace segsim::ros
