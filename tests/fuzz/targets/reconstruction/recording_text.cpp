// Text files of recordings (reconstruction/datasets): camera matrices and poses, labels.yaml,
// label maps, tables of ScanNet and Replica. The first byte says which.
#include "reconstruction/datasets/internal/calibration_files.h"
#include "reconstruction/datasets/label_map.h"
#include "reconstruction/datasets/labels_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  if (bytes.empty()) return;
  const std::filesystem::path file = in_file(bytes.substr(1));
  switch (bytes.front()) {
    case 'k':
      (void)reconstruction::internal::read_intrinsics(file, {640, 480}, 0.5);
      break;
    case 'p':
      for (const auto& line : reconstruction::internal::read_number_lines(file)) {
        (void)reconstruction::internal::pose_from_matrix(line.numbers, "input");
      }
      break;
    case 'l':
      (void)reconstruction::read_sequence_labels(file);
      break;
    case 'm':
      (void)reconstruction::read_label_map(file);
      break;
    case 's':
      (void)reconstruction::read_scannet_table(file);
      break;
    default:
      (void)reconstruction::read_replica_classes(file);
  }
}

std::vector<std::string> seeds() {
  return {
      "k500 0 320\n0 500 240\n0 0 1\n",
      "p1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1\n0 -1 0 1,1 0 0 2 0 0 1 3 0 0 0 1\n",
      "lschema: segsim.labels\nversion: 1\npixel_center: 0.5\nup: z\nsource: made up\n"
      "classes:\n  - {id: 1, name: chair, thing: true}\ninstances:\n"
      "  - {id: 1, class: 1, name: ChairA}\n  - {id: 2, class: 1, name: b, iscrowd: true}\n",
      "mschema: segsim.label_map\nversion: 1\nclasses:\n"
      "  - {id: 1, name: wall}\n  - {id: 2, name: chair, thing: true}\nids:\n"
      "  - {from: [2, 23], to: 2}\n",
      "sid\traw_category\tcategory\tcount\tnyu40id\teigen13id\n1\twall\twall\t9\t1\t12\n"
      "23\tarmchair\tchair\t5\t5\t4\n",
      R"(r{"classes": [{"id": 20, "name": "chair"}], "objects": [{"id": 12, "class_id": 20}]})"};
}

}  // namespace segsim::fuzz
