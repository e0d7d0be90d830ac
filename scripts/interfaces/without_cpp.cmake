# SPDX-License-Identifier: Apache-2.0
# Read by a package's project() (scripts/build_interfaces.py): rclpy loads what rosidl generates in C, and the C++ takes half of the time to compile.
find_package(rosidl_default_generators REQUIRED)
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
