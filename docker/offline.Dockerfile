# Analysis, comparison, export and simulation, without ROS:
#   docker build -f docker/offline.Dockerfile -t imu_bench_offline .
#   docker run --rm -v "$PWD:/data" imu_bench_offline analyze my_bag --html report.html
FROM python:3.13-slim AS build
WORKDIR /src
COPY . .
RUN python -m pip wheel --no-cache-dir --no-deps --wheel-dir /dist .

FROM python:3.13-slim
COPY --from=build /dist /dist
RUN python -m pip install --no-cache-dir /dist/*.whl && rm -r /dist
WORKDIR /data
ENTRYPOINT ["imu-bench"]
