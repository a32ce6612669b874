# The bench on ROS 2 Jazzy, for amd64 and arm64 (a Raspberry Pi):
#   docker build -f docker/jazzy.Dockerfile -t imu_bench .
#   docker run --rm -it --network host --device /dev/i2c-1 imu_bench ros2 launch imu_bench bench_launch.py
# both kinds at once: docker buildx build --platform linux/amd64,linux/arm64 -f docker/jazzy.Dockerfile .
FROM ros:jazzy-ros-base
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
WORKDIR /ws
COPY . src/imu_bench
RUN apt-get update \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src --ignore-src -y --dependency-types=exec \
    && apt-get install --yes --no-install-recommends python3-pip \
    && python3 -m pip install --no-cache-dir --break-system-packages \
        rosbags bokeh lz4 backports.zstd python-periphery \
    && rm -rf /var/lib/apt/lists/*
RUN source /opt/ros/jazzy/setup.bash && colcon build --packages-select imu_bench
ENTRYPOINT ["/ws/src/imu_bench/docker/in_workspace.sh"]
CMD ["imu-bench"]
