// Pinocchio's C++ loops for `hingepair bench robots --cpp`: what the Python loops do, from the same inputs into the same
// outputs. Only headers are used: a library that was compiled for another instruction set aligns otherwise.
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS
#define BOOST_MPL_LIMIT_LIST_SIZE 30
#define BOOST_MPL_LIMIT_VECTOR_SIZE 30
#define BOOST_FUSION_INVOKE_MAX_ARITY 12
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>

namespace pin = pinocchio;
using Matrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Vector = Eigen::Map<const Eigen::Vector3d>;
using Row = Eigen::Map<const Eigen::VectorXd>;

struct Robot
{
  pin::Model model;
  pin::Data data;
  pin::JointIndex tip;
};

// Joints that turn (0 to 2 about x, y, z; 3 about an axis of their own) or slide (4 to 7 likewise).
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

// Of each joint its parent, its kind, its placement (rotation row by row, then translation), its axis (3), and mass, centre
// (3) and inertia about it (9) of its body; tip: the joint whose pose and Jacobian are asked for.
extern "C" Robot * robot_new(
  long joints, long tip, const long * parents, const long * kinds, const double * placements, const double * axes,
  const double * masses, const double * centres, const double * inertias)
{
  pin::Model model;
  for (long i = 0; i < joints; ++i)
  {
    const Eigen::Matrix3d S = Eigen::Map<const Matrix>(placements + 12 * i);
    const Eigen::Matrix3d inertia = Eigen::Map<const Matrix>(inertias + 9 * i);
    const auto joint = model.addJoint(
      parents[i], joint_of(kinds[i], Eigen::Vector3d(Vector(axes + 3 * i))),
      pin::SE3(S, Vector(placements + 12 * i + 9)), "joint" + std::to_string(i));
    model.appendBodyToJoint(joint, pin::Inertia(masses[i], Vector(centres + 3 * i), inertia), pin::SE3::Identity());
  }
  return new Robot{model, pin::Data(model), pin::JointIndex(tip)};
}

extern "C" void robot_delete(Robot * robot)
{
  delete robot;
}

// what: 0 the tip's position and rotation (12 numbers), 1 its Jacobian (6 rows, world axes), 2 torques of accelerations w,
// 3 accelerations of torques w.
extern "C" void robot_run(
  Robot * robot, long what, long count, const double * q, const double * v, const double * w, double * out)
{
  const pin::Model & model = robot->model;
  pin::Data & data = robot->data;
  const long n = model.nv;
  Eigen::VectorXd qi(n), vi(n), wi(n);
  pin::Data::Matrix6x J(6, n);
  for (long i = 0; i < count; ++i)
  {
    qi = Row(q + n * i, n);
    if (what == 0)
    {
      pin::forwardKinematics(model, data, qi);
      Eigen::Map<Eigen::Vector3d>(out + 12 * i) = data.oMi[robot->tip].translation();
      Eigen::Map<Matrix>(out + 12 * i + 3) = data.oMi[robot->tip].rotation();
    }
    else if (what == 1)
    {
      pin::computeJointJacobians(model, data, qi);
      J.setZero();
      pin::getJointJacobian(model, data, robot->tip, pin::LOCAL_WORLD_ALIGNED, J);
      Eigen::Map<Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::RowMajor>>(out + 6 * n * i, 6, n) = J;
    }
    else
    {
      vi = Row(v + n * i, n);
      wi = Row(w + n * i, n);
      Eigen::Map<Eigen::VectorXd>(out + n * i, n) =
        what == 2 ? pin::rnea(model, data, qi, vi, wi) : pin::aba(model, data, qi, vi, wi);
    }
  }
}
