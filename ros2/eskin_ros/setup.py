"""Build of the package by colcon."""

from glob import glob

from setuptools import setup

NAME = "eskin_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*.yaml")),
    ],
    install_requires=["setuptools", "eskin>=0.2"],
    license="Apache-2.0",
    entry_points={"console_scripts": ["eskin_node = eskin_ros.node:main"]},
)
