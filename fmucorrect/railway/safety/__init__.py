"""Running safety, EN 14363 style: quantities of wheel forces, their section values, estimated maxima and limits."""
