#pragma once
/// Contacts of a Linux computer: lines of /dev/gpiochip*, kernel interface version 2 (Linux 5.10 and later).

#include <string>
#include <system_error>

namespace esmc::hal {

/// System calls of a line, replaceable in tests: open(2), ioctl(2) and close(2), with errno.
struct GpioKernel {
  int (*open)(const char* path, int flags);
  int (*ioctl)(int descriptor, unsigned long request, void* argument);
  int (*close)(int descriptor);
};
extern const GpioKernel gpio_kernel;  ///< of this computer

/// One GPIO line, released on destruction; the chip then decides the level of an output.
class GpioLine {
 public:
  /// Use of a line.
  enum class Use {
    contact,  ///< input, with the chip's pull-down if it has one: open reads low
    output,   ///< low from the request on
  };

  GpioLine() = default;
  GpioLine(const GpioLine&) = delete;
  GpioLine& operator=(const GpioLine&) = delete;
  ~GpioLine();

  /// Opens a line, once. `place`: chip and offset, "gpiochip0:17"; `consumer`: name for other programs, <= 31
  /// characters. invalid_argument: no valid place or open already; else the kernel's error (EBUSY: in use).
  /// `kernel` must outlive the line.
  [[nodiscard]] std::error_code request(const std::string& place, Use use, const char* consumer,
                                        const GpioKernel& kernel = gpio_kernel);
  [[nodiscard]] bool is_open() const { return line_ >= 0; }  ///< request() has succeeded

  /// True if the contact is closed (hal::DigitalInput), and without a request; false if it cannot be read.
  [[nodiscard]] bool closed() const;
  /// Sets the level (hal::DigitalOutput); no effect, and true, without a request. False: the kernel refused.
  bool set(bool high) const;

 private:
  const GpioKernel* kernel_ = nullptr;
  int line_ = -1;
};

}  // namespace esmc::hal
