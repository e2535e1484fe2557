#ifndef Elunar_StripTester_HPP
#define Elunar_StripTester_HPP
#include "Strip/Strip.hpp"
#include "Strip/StripGTestBase.hpp"
namespace Elunar {
class StripTester : public StripGTestBase {
  public:
    static const FwSizeType MAX_HISTORY_SIZE = 2000;
    static const FwEnumStoreType TEST_INSTANCE_ID = 0;
    static const FwSizeType TEST_INSTANCE_QUEUE_DEPTH = 10;
    StripTester();
    ~StripTester();
    void made();
    void madeFromPosts();
    void refusedAndBroken();
  PRIVATE:
    void connectPorts();
    void initComponents();
    void make(const char* coarse, U32 cols, U32 postCols);
    void tickWhileMaking();
    Strip component;
};
}  // namespace Elunar
#endif
