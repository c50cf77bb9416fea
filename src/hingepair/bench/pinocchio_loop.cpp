// Pinocchio's C++ loops for `hingepair bench direct|dynamics --cpp`: what the Python loops do, from the same inputs into the
// same outputs. Only headers are used: a library that was compiled for another instruction set aligns otherwise.
// Pinocchio's variants of joints are longer than Boost's lists are by themselves.
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS
#define BOOST_MPL_LIMIT_LIST_SIZE 30
#define BOOST_MPL_LIMIT_VECTOR_SIZE 30
#define BOOST_FUSION_INVOKE_MAX_ARITY 12
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/multibody.hpp>
#ifdef DYNAMICS  // whose headers take the compiler a minute
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#endif

namespace pin = pinocchio;
using Matrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Row = Eigen::Map<const Eigen::VectorXd>;
using Constant = Eigen::Map<const Eigen::Vector3d>;
using Out = Eigen::Map<Eigen::Vector3d>;

struct Pair
{
  pin::Model model;
  pin::Data data;
  pin::FrameIndex frame;
};

// u1, u2, n: 3 numbers; home: 9, row by row; of each body (two or none) its mass, its centre from the reference point (3)
// and its inertia about it (9), body axes.
extern "C" Pair * pair_new(
  long bodies, const double * u1, const double * u2, const double * n, const double * home, const double * masses,
  const double * centres, const double * inertias)
{
  const Eigen::Matrix3d C = Eigen::Map<const Matrix>(home);
  pin::Model model;
  const auto body1 = model.addJoint(0, pin::JointModelFreeFlyer(), pin::SE3::Identity(), "body1");
  const auto hinge = model.addJoint(
    body1, pin::JointModelRevoluteUnaligned(Eigen::Vector3d(Constant(n))),
    pin::SE3(Eigen::Matrix3d::Identity(), Constant(u1)), "hinge");
  const pin::SE3 placement(C, -(C * Constant(u2)));
  const auto frame = model.addFrame(pin::Frame("body2", hinge, placement, pin::OP_FRAME));
  for (long i = 0; i < bodies; ++i)
  {
    const Eigen::Matrix3d inertia = Eigen::Map<const Matrix>(inertias + 9 * i);
    model.appendBodyToJoint(
      i == 0 ? body1 : hinge, pin::Inertia(masses[i], Constant(centres + 3 * i), inertia),
      i == 0 ? pin::SE3::Identity() : placement);
  }
  return new Pair{model, pin::Data(model), frame};
}

extern "C" void pair_delete(Pair * pair)
{
  delete pair;
}

// q: 8 numbers a sample, v and a: 7, or null from the first that is not wanted on. Outputs: 3 numbers a sample, S2 9.
extern "C" void pair_loop(
  Pair * pair, long count, const double * q, const double * v, const double * a, double * R2, double * S2,
  double * v2, double * omega2, double * a2, double * alpha2)
{
  const pin::Model & model = pair->model;
  pin::Data & data = pair->data;
  Eigen::VectorXd qi(8), vi(7), ai(7);
  for (long i = 0; i < count; ++i)
  {
    qi = Row(q + 8 * i, 8);
    if (v)
      vi = Row(v + 7 * i, 7);
    if (a)
      ai = Row(a + 7 * i, 7);
    if (a)
      pin::forwardKinematics(model, data, qi, vi, ai);
    else if (v)
      pin::forwardKinematics(model, data, qi, vi);
    else
      pin::forwardKinematics(model, data, qi);
    const pin::SE3 & placement = pin::updateFramePlacement(model, data, pair->frame);
    Out(R2 + 3 * i) = placement.translation();
    Eigen::Map<Matrix>(S2 + 9 * i) = placement.rotation();
    if (v)
    {
      const pin::Motion twist = pin::getFrameVelocity(model, data, pair->frame, pin::LOCAL_WORLD_ALIGNED);
      Out(v2 + 3 * i) = twist.linear();
      Out(omega2 + 3 * i) = twist.angular();
    }
    if (a)
    {
      const pin::Motion change =
        pin::getFrameClassicalAcceleration(model, data, pair->frame, pin::LOCAL_WORLD_ALIGNED);
      Out(a2 + 3 * i) = change.linear();
      Out(alpha2 + 3 * i) = change.angular();
    }
  }
}

#ifdef DYNAMICS

// As the model's own rnea (w: accelerations, out: forces) or, inverse = 0, aba (the other way round); 7 numbers each.
extern "C" void pair_dynamics(
  Pair * pair, long inverse, long count, const double * q, const double * v, const double * w, double * out)
{
  Eigen::VectorXd qi(8), vi(7), wi(7);
  for (long i = 0; i < count; ++i)
  {
    qi = Row(q + 8 * i, 8);
    vi = Row(v + 7 * i, 7);
    wi = Row(w + 7 * i, 7);
    Eigen::Map<Eigen::VectorXd>(out + 7 * i, 7) =
      inverse ? pin::rnea(pair->model, pair->data, qi, vi, wi) : pin::aba(pair->model, pair->data, qi, vi, wi);
  }
}

#endif
