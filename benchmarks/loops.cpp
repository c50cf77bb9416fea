// Pinocchio's C++ loops of the benchmarks' `--cpp`: what the Python loops do, from the same inputs. Only headers are used: a library that was compiled for another instruction set aligns otherwise.
// Pinocchio's variants of joints are longer than Boost's lists are by themselves.
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS
#define BOOST_MPL_LIMIT_LIST_SIZE 30
#define BOOST_MPL_LIMIT_VECTOR_SIZE 30
#define BOOST_FUSION_INVOKE_MAX_ARITY 12
#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/spatial.hpp>

namespace pin = pinocchio;
using Matrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Constant = Eigen::Map<const Eigen::Vector3d>;
using Row = Eigen::Map<const Eigen::VectorXd>;
using Out = Eigen::Map<Eigen::Vector3d>;
using Square = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

struct System
{
  pin::Model model;
  pin::Data data;
  pin::FrameIndex frame;
};

static pin::SE3 placement_of(const double * numbers) // a rotation row by row, then a translation
{
  const Eigen::Matrix3d S = Eigen::Map<const Matrix>(numbers);
  return pin::SE3(S, Constant(numbers + 9));
}

// The order of `_JOINTS` in engines.py.
static pin::JointModel joint_of(long kind, const Eigen::Vector3d & axis)
{
  switch (kind)
  {
  case 0: return pin::JointModelRX();
  case 1: return pin::JointModelRY();
  case 2: return pin::JointModelRZ();
  case 3: return pin::JointModelRevoluteUnaligned(axis);
  case 4: return pin::JointModelPX();
  case 5: return pin::JointModelPY();
  case 6: return pin::JointModelPZ();
  default: return pin::JointModelPrismaticUnaligned(axis);
  }
}

// Of each joint its parent, its kind, its placement (12 numbers), its axis (3), and mass, centre (3) and inertia about it (9)
// of its body; of the frame the joint that carries it and its placement.
extern "C" System * system_new(
  long joints, const long * parents, const long * kinds, const double * placements, const double * axes,
  const double * masses, const double * centres, const double * inertias, long carrier, const double * frame)
{
  pin::Model model;
  for (long i = 0; i < joints; ++i)
  {
    const Eigen::Matrix3d inertia = Eigen::Map<const Matrix>(inertias + 9 * i);
    const auto joint = model.addJoint(
      parents[i], joint_of(kinds[i], Eigen::Vector3d(Constant(axes + 3 * i))), placement_of(placements + 12 * i),
      "joint" + std::to_string(i));
    model.appendBodyToJoint(joint, pin::Inertia(masses[i], Constant(centres + 3 * i), inertia), pin::SE3::Identity());
  }
  const auto index = model.addFrame(pin::Frame("frame", carrier, placement_of(frame), pin::OP_FRAME));
  return new System{model, pin::Data(model), index};
}

extern "C" void system_delete(System * system)
{
  delete system;
}

static void write_pose(System * system, double * out)
{
  const pin::SE3 & placement = pin::updateFramePlacement(system->model, system->data, system->frame);
  Out{out} = placement.translation();
  Eigen::Map<Matrix>(out + 3) = placement.rotation();
}

// what: an index into `WORKLOADS` of engines.py. Inputs: rows of q, v and w (accelerations or efforts), null from the first
// that is not needed on. Output: a row of `width` numbers for each state.
extern "C" void system_run(
  System * system, long what, long count, long width, const double * q, const double * v, const double * w, double * out)
{
  const pin::Model & model = system->model;
  pin::Data & data = system->data;
  const long n = model.nv;
  Eigen::VectorXd qi(model.nq), vi(n), wi(n);
  pin::Data::Matrix6x J(6, n);
  for (long i = 0; i < count; ++i, out += width)
  {
    qi = Row(q + model.nq * i, model.nq);
    if (v)
      vi = Row(v + n * i, n);
    if (w)
      wi = Row(w + n * i, n);
    switch (what)
    {
    case 0: // pose
      pin::forwardKinematics(model, data, qi);
      write_pose(system, out);
      break;
    case 1: // Jacobian
      J.setZero();
      pin::computeJointJacobians(model, data, qi);
      pin::updateFramePlacement(model, data, system->frame);
      pin::getFrameJacobian(model, data, system->frame, pin::LOCAL_WORLD_ALIGNED, J);
      Eigen::Map<Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::RowMajor>>(out, 6, n) = J;
      break;
    case 2: // inverse dynamics
      Eigen::Map<Eigen::VectorXd>(out, n) = pin::rnea(model, data, qi, vi, wi);
      break;
    case 3: // forward dynamics
      Eigen::Map<Eigen::VectorXd>(out, n) = pin::aba(model, data, qi, vi, wi);
      break;
    case 4: // derivatives of torques
      pin::computeRNEADerivatives(model, data, qi, vi, wi);
      Square(out, n, n) = data.dtau_dq;
      Square(out + n * n, n, n) = data.dtau_dv;
      break;
    case 5: // derivatives of accelerations
      pin::computeABADerivatives(model, data, qi, vi, wi);
      Square(out, n, n) = data.ddq_dq;
      Square(out + n * n, n, n) = data.ddq_dv;
      break;
    }
  }
}

// Closed-loop inverse kinematics: what `pinocchio_job` of inverse_kinematics.py does. A row of `out` for each target holds the
// coordinates; targets are placements, starts have a row for each trial.
extern "C" void system_reach(
  System * system, long count, long trials, long steps, double tolerance, double damping, const double * low,
  const double * high, const double * targets, const double * starts, double * out)
{
  const pin::Model & model = system->model;
  pin::Data & data = system->data;
  const long n = model.nv;
  const Row least(low, n), greatest(high, n);
  Eigen::VectorXd q(n), v(n);
  pin::Data::Matrix6x J(6, n);
  pin::Data::Matrix6 log, square;
  for (long i = 0; i < count; ++i, targets += 12, out += n)
  {
    const pin::SE3 target = placement_of(targets);
    bool solved = false;
    for (long trial = 0; trial < trials && !solved; ++trial)
    {
      q = Row(starts + n * trial, n);
      for (long step = 0; step < steps; ++step)
      {
        pin::forwardKinematics(model, data, q);
        const pin::SE3 off = pin::updateFramePlacement(model, data, system->frame).actInv(target);
        const Eigen::Matrix<double, 6, 1> error = pin::log6(off).toVector();
        solved = off.translation().norm() <= tolerance && error.tail<3>().norm() <= tolerance;
        if (solved)
          break;
        J.setZero();
        pin::computeFrameJacobian(model, data, q, system->frame, pin::LOCAL, J);
        pin::Jlog6(off.inverse(), log);
        J = -log * J;
        square.noalias() = J * J.transpose();
        square.diagonal().array() += damping;
        v.noalias() = -J.transpose() * square.ldlt().solve(error);
        q = (q + v).cwiseMax(least).cwiseMin(greatest);
      }
    }
    Eigen::Map<Eigen::VectorXd>(out, n) = q;
  }
}

// Motions by semi-implicit Euler: what `pinocchio_job` of rollouts.py does. Rows of q and v begin with the start.
extern "C" void system_roll(System * system, long motions, long steps, double h, const double * tau, double * q, double * v)
{
  const long n = system->model.nv;
  Eigen::VectorXd qi(n), vi(n), load(n);
  for (long i = 0; i < motions; ++i, q += n, v += n)
  {
    qi = Row(q, n);
    vi = Row(v, n);
    for (long k = 0; k < steps; ++k, tau += n)
    {
      load = Row(tau, n);
      vi += h * pin::aba(system->model, system->data, qi, vi, load);
      qi += h * vi;
      q += n;
      v += n;
      Eigen::Map<Eigen::VectorXd>(q, n) = qi;
      Eigen::Map<Eigen::VectorXd>(v, n) = vi;
    }
  }
}
