// A simulated measurement as the message that the vehicle's instrument would put on the bus.
#pragma once

#include "rsfm/io/mission.h"
#include "rsfm/io/rig.h"
#include "tools/simulator/nav_sensors.h"

namespace rsfm::simulator {

// On the rig's channel for its type, or on the type's usual one.
IoStatus LogMeasurement(const NavMeasurement& measurement, const Rig& rig, MissionWriter* writer);

}  // namespace rsfm::simulator
