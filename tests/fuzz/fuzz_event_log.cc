// events.lcm: every byte of the file is in an event, in a damaged place, or cut off.
#include "rsfm/io/event_log.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rsfm;
  const std::filesystem::path path = FuzzFolder() / "events.lcm";
  WriteFuzzFile(path, AsText(data, size));
  auto reader = EventLogReader::Open(path);
  Require(reader.has_value());
  LogEvent event;
  std::int64_t bytes = 0;
  while (true) {
    const auto has_event = reader->Next(&event);
    Require(has_event.has_value());
    if (!*has_event) break;
    bytes +=
        static_cast<std::int64_t>(kEventHeaderBytes + event.channel.size() + event.data.size());
  }
  const EventLogStatistics& log = reader->statistics();
  Require(bytes + log.damaged_bytes + log.cut_bytes == static_cast<std::int64_t>(size));
  return 0;
}
