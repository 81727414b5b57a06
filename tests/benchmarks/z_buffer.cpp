// A plain z-buffer as programs for dense face alignment have it: a loop over triangles and over the pixels of their
// bounding boxes, in float32, with weights from dot products; one picture of three bytes a pixel.

#include <algorithm>
#include <cmath>

struct Point {
    float x, y;
};

static void weights_at(float *weights, Point p, Point a, Point b, Point c) {
    const Point v0 = {c.x - a.x, c.y - a.y}, v1 = {b.x - a.x, b.y - a.y}, v2 = {p.x - a.x, p.y - a.y};
    const float dot00 = v0.x * v0.x + v0.y * v0.y, dot01 = v0.x * v1.x + v0.y * v1.y;
    const float dot02 = v0.x * v2.x + v0.y * v2.y, dot11 = v1.x * v1.x + v1.y * v1.y;
    const float dot12 = v1.x * v2.x + v1.y * v2.y;
    const float determinant = dot00 * dot11 - dot01 * dot01;
    const float inverse = determinant == 0 ? 0 : 1 / determinant;
    const float u = (dot11 * dot02 - dot01 * dot12) * inverse, v = (dot00 * dot12 - dot01 * dot02) * inverse;
    weights[0] = 1 - u - v;
    weights[1] = v;
    weights[2] = u;
}

extern "C" void draw(unsigned char *image, const float *vertices, const int *triangles, const float *colours,
                     float *depth, int n_triangles, int height, int width, int channels, float alpha) {
    for (int i = 0; i < n_triangles; ++i) {
        const int *corner = triangles + 3 * i;
        const float *a = vertices + 3 * corner[0], *b = vertices + 3 * corner[1], *c = vertices + 3 * corner[2];
        const int left = std::max((int)std::ceil(std::min(a[0], std::min(b[0], c[0]))), 0);
        const int right = std::min((int)std::floor(std::max(a[0], std::max(b[0], c[0]))), width - 1);
        const int top = std::max((int)std::ceil(std::min(a[1], std::min(b[1], c[1]))), 0);
        const int bottom = std::min((int)std::floor(std::max(a[1], std::max(b[1], c[1]))), height - 1);
        for (int y = top; y <= bottom; ++y) {
            for (int x = left; x <= right; ++x) {
                float weights[3];
                weights_at(weights, {(float)x, (float)y}, {a[0], a[1]}, {b[0], b[1]}, {c[0], c[1]});
                if (weights[0] < 0 || weights[1] < 0 || weights[2] < 0) continue;
                const float z = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
                const int pixel = y * width + x;
                if (z <= depth[pixel]) continue;
                depth[pixel] = z;
                for (int k = 0; k < channels; ++k) {
                    const float colour = weights[0] * colours[channels * corner[0] + k] +
                                         weights[1] * colours[channels * corner[1] + k] +
                                         weights[2] * colours[channels * corner[2] + k];
                    unsigned char &value = image[channels * pixel + k];
                    value = (unsigned char)((1 - alpha) * value + alpha * 255 * colour);
                }
            }
        }
    }
}
