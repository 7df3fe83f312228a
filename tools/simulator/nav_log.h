// A simulated measurement as the message that the vehicle's instrument would put on the bus.
#pragma once

#include "rsfm/io/mission.h"
#include "rsfm/io/rig.h"
#include "rsfm/navigation/local_frame.h"
#include "tools/simulator/nav_sensors.h"

namespace rsfm::simulator {

// On the rig's channel for its type, or on the type's usual one. Positions are geodetic fixes of
// the transponder where there is a `frame`, else positions of the body in the local frame.
IoStatus LogMeasurement(const NavMeasurement& measurement, const Rig& rig, const LocalFrame* frame,
                        MissionWriter* writer);

}  // namespace rsfm::simulator
