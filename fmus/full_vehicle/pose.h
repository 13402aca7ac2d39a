/* Six-vectors: small displacements of a rigid body (or their rates), and wrenches. Axes x forward, y right, z up; roll
 * with the top to the right, pitch with the nose up, yaw with the front to the right. A small rotation moves the point
 * (x, y, z) by  -y yaw - z pitch  forward,  x yaw + z roll  to the right,  x pitch - y roll  upwards. */
#ifndef FULL_VEHICLE_POSE_H
#define FULL_VEHICLE_POSE_H

typedef struct {
    double x, y, z;
} Vector;

typedef struct {
    double x, y, z, roll, pitch, yaw; /* displacement, m and rad; or force and moment, N and N m */
} Six;

static inline Six six_add(Six a, Six b)
{
    return (Six){a.x + b.x, a.y + b.y, a.z + b.z, a.roll + b.roll, a.pitch + b.pitch, a.yaw + b.yaw};
}

static inline Six six_scale(Six a, double k)
{
    return (Six){k * a.x, k * a.y, k * a.z, k * a.roll, k * a.pitch, k * a.yaw};
}

static inline Six six_subtract(Six a, Six b) { return six_add(a, six_scale(b, -1.0)); }

/* How far the body's point p has moved, p counted from the point whose displacement d is. */
static inline Vector point_displacement(Six d, Vector p)
{
    return (Vector){d.x - p.y * d.yaw - p.z * d.pitch, d.y + p.x * d.yaw + p.z * d.roll,
                    d.z + p.x * d.pitch - p.y * d.roll};
}

/* The same displacement, said of the body's point p. */
static inline Six displacement_at(Six d, Vector p)
{
    const Vector u = point_displacement(d, p);
    return (Six){u.x, u.y, u.z, d.roll, d.pitch, d.yaw};
}

/* A force f at the point p: the wrench about the origin. */
static inline Six wrench_of(Vector f, Vector p)
{
    return (Six){f.x, f.y, f.z, p.z * f.y - p.y * f.z, p.x * f.z - p.z * f.x, p.x * f.y - p.y * f.x};
}

/* The wrench w about the origin, said about the point p. */
static inline Six wrench_at(Six w, Vector p)
{
    return six_subtract(w, (Six){0, 0, 0, p.z * w.y - p.y * w.z, p.x * w.z - p.z * w.x, p.x * w.y - p.y * w.x});
}

/* The components of w in a frame that is turned by a small roll and yaw against the one that they are given in. */
static inline Six wrench_seen_from(Six w, double roll, double yaw)
{
    return (Six){
        w.x + w.y * yaw,        w.y - w.x * yaw - w.z * roll,          w.z + w.y * roll,
        w.roll + w.pitch * yaw, w.pitch - w.roll * yaw + w.yaw * roll, w.yaw - w.pitch * roll,
    };
}

#endif
