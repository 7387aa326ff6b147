"""ROS 2 definitions of the messages in a recording, each with all it refers to."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Topic:
    """A topic of a recording, the type of its messages and their definition."""

    name: str
    type_name: str
    definition: str


def definition(own: str, *others: tuple[str, str]) -> str:
    """Join a definition and those it refers to, as rosbag2 stores them."""
    rule = "=" * 80
    parts = [own.strip()]
    parts += [f"{rule}\nMSG: {name}\n{text.strip()}" for name, text in others]
    return "\n".join(parts) + "\n"


TIME = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec")
HEADER = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id")
POINT = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z")
VECTOR = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z")

READING = Topic(
    "/eskin/reading",
    "eskin_msgs/msg/Reading",
    definition(
        """
# One instant of the whole skin, before calibration. frame_id is the skin's name.
std_msgs/Header header
# One count a taxel, in the order of the attached skin.
uint16[] counts
# False where no fresh data came.
bool[] received
# Counts along each taxel's tangent x and y in turn; empty where shear is not measured.
int16[] shear
""",
        HEADER,
        TIME,
    ),
)

JOINT_STATES = Topic(
    "/joint_states",
    "sensor_msgs/msg/JointState",
    definition(
        """
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
""",
        HEADER,
        TIME,
    ),
)

LABEL = Topic(
    "/eskin/label",
    "eskin_msgs/msg/Label",
    definition(
        """
# One gesture from start until just before end. source: true, range or auto.
builtin_interfaces/Time start
builtin_interfaces/Time end
string gesture
string source
""",
        TIME,
    ),
)

DETECTION = Topic(
    "/eskin/detection",
    "eskin_msgs/msg/Detection",
    definition(
        """
# What was recognised of one touch, when it was said. frame_id is world.
std_msgs/Header header
string gesture
float32 confidence
builtin_interfaces/Time onset
builtin_interfaces/Time end
string link
string patch
geometry_msgs/Point point
geometry_msgs/Vector3 normal
# Unit direction of travel; zero where the touch stood still.
geometry_msgs/Vector3 direction
# Largest force of the touch [N].
float32 peak_force
""",
        HEADER,
        TIME,
        POINT,
        VECTOR,
    ),
)

TRUTH = Topic(
    "/eskin/truth",
    "eskin_msgs/msg/Truth",
    definition(
        """
# What one touch really was at one reading, while in contact; known where the skin is
# simulated. frame_id is world.
std_msgs/Header header
# Counts the touches of the file.
uint32 touch
string gesture
# Variant of the gesture.
string kind
# Link that bears most of it.
string link
# Total force on the skin [N].
float64 force
# Contact area [m2].
float64 area
# Centre of the force [m].
geometry_msgs/Point centroid
""",
        HEADER,
        TIME,
        POINT,
    ),
)

EVENT = Topic(
    "/eskin/event",
    "eskin_msgs/msg/Event",
    definition(
        """
# Something that happened to the skin. frame_id is the skin's name.
std_msgs/Header header
string kind
# The same as a sentence.
string text
# Empty where it is of no one patch.
string patch
# -1 where it is of no one row, column or taxel.
int32 row
int32 column
int32 taxel
""",
        HEADER,
        TIME,
    ),
)

TOPICS = (READING, JOINT_STATES, LABEL, DETECTION)
"""Those of every recording; `TRUTH` and `EVENT` are only in those that have some."""
