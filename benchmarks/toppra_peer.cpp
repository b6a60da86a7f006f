// TOPP-RA's C++ library on one problem, timed inside: spline, constraints, solution, law.
//
// Reads: joints, waypoints, grid points, runs; spline parameters; waypoints row by row; lower and
// upper bounds of the velocities, and of the accelerations; grid. Writes: the duration and the time of every run [s]; ds² on the grid.

#include <cstdio>
#include <ctime>
#include <iostream>
#include <memory>
#include <vector>

#include <toppra/algorithm/toppra.hpp>
#include <toppra/constraint/linear_joint_acceleration.hpp>
#include <toppra/constraint/linear_joint_velocity.hpp>
#include <toppra/geometric_path/piecewise_poly_path.hpp>
#include <toppra/parametrizer/const_accel.hpp>
#include <toppra/solver/seidel.hpp>

namespace {

toppra::Vector read(std::size_t n) {
  toppra::Vector values(n);
  for (std::size_t i = 0; i < n; ++i) std::cin >> values[i];
  return values;
}

}  // namespace

int main() {
  std::size_t joints, waypoints, points, runs;
  std::cin >> joints >> waypoints >> points >> runs;
  const toppra::Vector at = read(waypoints);
  toppra::Vectors positions;
  for (std::size_t i = 0; i < waypoints; ++i) positions.push_back(read(joints));
  const toppra::Vector slowest = read(joints), fastest = read(joints);
  const toppra::Vector lowest = read(joints), highest = read(joints), grid = read(points);
  std::vector<double> times;
  double duration = 0;
  toppra::Vector squares;
  for (std::size_t run = 0; run < runs + 1; ++run) {
    const std::clock_t start = std::clock();  // of the processor
    const toppra::BoundaryCondFull natural{toppra::BoundaryCond("natural"),
                                           toppra::BoundaryCond("natural")};
    auto path = std::make_shared<toppra::PiecewisePolyPath>(
        toppra::PiecewisePolyPath::CubicSpline(positions, at, natural));
    toppra::LinearConstraintPtrs constraints{
        std::make_shared<toppra::constraint::LinearJointVelocity>(slowest, fastest),
        std::make_shared<toppra::constraint::LinearJointAcceleration>(lowest, highest)};
    for (auto& constraint : constraints) constraint->discretizationType(toppra::Interpolation);
    toppra::algorithm::TOPPRA problem(constraints, path);
    problem.solver(std::make_shared<toppra::solver::Seidel>());
    problem.setGridpoints(grid);
    if (problem.computePathParametrization(0, 0) != toppra::ReturnCode::OK) return 1;
    squares = problem.getParameterizationData().parametrization;
    toppra::parametrizer::ConstAccel law(path, grid, squares);
    if (!law.validate()) return 2;
    duration = law.pathInterval()[1];
    const double taken = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    if (run > 0) times.push_back(taken);  // the first one warms up
  }
  std::printf("%.12g", duration);
  for (const double taken : times) std::printf(" %.9g", taken);
  std::printf("\n");
  for (std::size_t i = 0; i < points; ++i) std::printf("%.17g\n", squares[i]);
  return 0;
}
